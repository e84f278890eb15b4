"""The outsiders' network with the contract on it, brought by `ledgerline contract` alone, and the configs of who uses it."""
import contextlib
import json
import pathlib
import subprocess
import time

from consortium import TIMEOUT_S, Consortium
from fabric import FABRIC, needs_fabric
from flights import BIN, control


@contextlib.contextmanager
def consortium(directory: pathlib.Path):
    needs_fabric()
    directory.mkdir()
    network = Consortium(directory, FABRIC)
    try:
        network.up()
        yield network
    except BaseException:
        print(network.logs(), flush=True)
        raise
    finally:
        network.down()


def contract(*words) -> str:
    done = subprocess.run([BIN / "ledgerline", "contract", *words], capture_output=True, text=True, timeout=2 * TIMEOUT_S)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


def ledger_file(network: Consortium, k: int, user: str, whole: bool = False, direct: bool = True) -> pathlib.Path:
    """Org1 names files, Org2 a folder. `whole`: with all that agent and ground want."""
    org, own = network.organisations[k - 1], network.users[k, user]

    def server(port: int, name: str, authority) -> str:
        return f'endpoint = "127.0.0.1:{port}"\nserver_name = "{name}"\ntls_ca = "{authority.root.certificate}"\n'

    identity = (f'msp_dir = "{own}/msp"\n' if k == 2 else
                f'certificate = "{own}/msp/signcerts/cert.pem"\nprivate_key = "{own}/msp/keystore/priv_sk"\n')
    text = (f'[ledger]\n{server(network.peer_ports[k - 1], f"peer0.{org.domain}", org.tlsca)}channel = "mychannel"\ncontract = "drones"\n'
            f'tls_certificate = "{own}/tls/server.crt"\ntls_key = "{own}/tls/server.key"\nmsp_id = "{org.msp_id}"\n{identity}'
            f'config_block = "{network.block}"\n')
    text += 'timeouts = "auto"\n' if whole else "deadline_ms = 10000\n"
    if whole and direct:
        text += f'[[orderer]]\n{server(network.orderer_port, "orderer.example.com", network.ordering.tlsca)}'
        for each, port in zip(network.organisations, network.peer_ports):
            text += f'[[endorser]]\nmsp_id = "{each.msp_id}"\n{server(port, f"peer0.{each.domain}", each.tlsca)}'
    if whole:
        for each in network.organisations:
            bundle = network.directory / f"{each.domain}-ca.pem"
            bundle.write_text(each.ca.root.certificate.read_text() + each.ca.certificate.read_text() * bool(each.ca.chain))
            text += f'[[msp]]\nid = "{each.msp_id}"\nca = "{bundle}"\n'
    file = network.directory / f"{org.domain}-{user}{'-whole' * whole}.toml"
    file.write_text(text)
    return file


def printed_commands(network: Consortium, *words) -> None:
    done = subprocess.run(["sh", "-c", contract(*words, "--print")], capture_output=True, text=True, timeout=TIMEOUT_S,
                          env={"PATH": f"{network.fabric}:/usr/bin:/bin", "FABRIC_CFG_PATH": network.fabric / "config"})
    assert done.returncode == 0, done.stdout + done.stderr


def bring_contract(network: Consortium) -> None:
    """Packed, served, installed, approved, committed; each step twice, since what is done is no error."""
    admins = [ledger_file(network, k, "Admin") for k in (1, 2)]
    for k, (org, admin) in enumerate(zip(network.organisations, admins), 1):
        package, service, peer = network.directory / f"org{k}.tgz", network.services[k - 1], network.peers[k - 1]
        port = network.service_ports[k - 1]
        words = ("package", "--address", f"localhost:{port}", "--tls-root", service / "tls/ca.crt", "--client-certificate",
                 peer / "tls/server.crt", "--client-key", peer / "tls/server.key", "--label", f"drones_{k}", "--out", package)
        identifier = contract(*words).strip()
        assert contract(*words).strip() == identifier
        network.start(f"service{k}", [BIN / "ledgerline-chaincode"], {
            "CHAINCODE_ID": identifier, "CHAINCODE_SERVER_ADDRESS": f"127.0.0.1:{port}", "CHAINCODE_TLS_KEY": f"{service}/tls/server.key",
            "CHAINCODE_TLS_CERT": f"{service}/tls/server.crt", "CHAINCODE_TLS_CLIENT_CA": f"{service}/tls/ca.crt",
            "CHAINCODE_TLS_CLIENT_NAMES": peer.name})
        if k == 1:
            early = subprocess.run([BIN / "ledgerline", "contract", "approve", "--config", admin, "--package", package],
                                   capture_output=True, text=True, timeout=TIMEOUT_S)
            assert early.returncode == 1 and "this peer has not installed" in early.stderr, early.stderr
            assert "installed drones_1:" in contract("install", "--config", admin, "--package", package)
        else:  # by the printed commands of Fabric's own program, which come to the same
            printed_commands(network, "install", "--config", admin, "--package", package)
            printed_commands(network, "approve", "--config", ledger_file(network, k, "Admin", whole=True), "--package", package)
        assert "is installed already" in contract("install", "--config", admin, "--package", package)
        for done in ("approved version 4 sequence 1", "is approved already")[k - 1:]:
            assert done in contract("approve", "--config", admin, "--package", package)
        if k == 1:
            status = json.loads(contract("status", "--config", admin, "--json"))
            assert status["next"]["approvals"] == {"Org1MSP": True, "Org2MSP": False} and "committed" not in status
    for done in ("committed version 4 sequence 1", "is committed already"):
        assert done in contract("commit", "--config", admins[0])
    print(contract("status", "--config", admins[1]), flush=True)
    status = json.loads(contract("status", "--config", admins[1], "--json"))
    assert status["committed"]["direct_path"] is True and status["committed"]["policy"] == "the channel's, MAJORITY Endorsement"
    assert status["committed"]["service"] == {"answers": True} and status["committed"]["own_package"] in status["installed"]
    assert status["channel"]["batch_timeout_s"] == 2 and status["channel"]["batch_max_messages"] == 10


def enrol(network: Consortium) -> None:
    admins = [ledger_file(network, k, "Admin") for k in (1, 2)]

    def soon(*words) -> None:
        """A gateway may just hear of the other peer, and of the contract."""
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            try:
                return control(*words)
            except subprocess.CalledProcessError:
                if time.monotonic() > deadline:
                    raise
            time.sleep(0.5)

    certificates = [network.users[k, "User1"] / "msp/signcerts/cert.pem" for k in (1, 2)]
    soon(admins[0], "enroll", "--msp", "Org1MSP", "--cert", certificates[0], "tello1")
    soon(admins[1], "enroll", "--msp", "Org2MSP", "--cert", certificates[1], "--role", "operator")
    soon(admins[0], "grant", "--msp", "Org2MSP", "--fly", "--stop", "--max-priority", "10", "tello1")
