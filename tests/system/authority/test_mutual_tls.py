"""An embedded ledger, and an endorser beside it, that ask their clients for a certificate of TLS: who has none, or an outsider's, is not let in; who has one is answered."""
import json
import pathlib
import socket
import ssl
import subprocess
import time

import findings
import pytest
from endorsers import Endorser
from fabric import BIN, Peer, needs_fabric
from ledgers import Embedded, openssl, tables
from netns import die_with_parent

TIMEOUT_S = 60


def tls_pair(ledger: Embedded, organisation: int, user: str = "User1") -> tuple[pathlib.Path, pathlib.Path]:
    folder = ledger.msp_dir(organisation, user).parent / "tls"
    return folder / "client.crt", folder / "client.key"


def own_pair(ledger: Embedded, organisation: int, user: str = "User1") -> tuple[pathlib.Path, pathlib.Path]:
    """The identity itself."""
    msp = ledger.msp_dir(organisation, user)
    return next((msp / "signcerts").iterdir()), next((msp / "keystore").iterdir())


def outsiders_pair(folder: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    key, certificate = folder / "outsider.key", folder / "outsider.pem"
    openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "9", "-subj", "/CN=outsider",
            "-keyout", key, "-out", certificate)
    key.chmod(0o600)
    return certificate, key


@pytest.fixture(scope="module")
def ledger(tmp_path_factory):
    """It takes what the TLS authorities of Org1 and Org2 have signed, and the identities of Org1."""
    node = Embedded(tmp_path_factory.mktemp("node") / "ledger")
    node.stop()
    authorities = node.ca_file(1), node.ca_file(2), node.organisation(1) / "ca/ca.org1.ledgerline-cert.pem"
    node.options = tuple(word for file in authorities for word in ("--tls-client-ca", file))
    node.start()
    yield node
    node.stop()


@pytest.fixture(scope="module")
def endorser(ledger, tmp_path_factory):
    """It takes what the TLS authority of Org1 has signed, and nobody else: not all whom the ledger takes."""
    running = Endorser(ledger, tmp_path_factory.mktemp("endorser"), f'tls_client_ca = "{ledger.ca_file(1)}"\n', tls_pair(ledger, 1))
    yield running
    assert running.stop()["differ"] == 0


def config(ledger: Embedded, organisation: int, pair: tuple | None, more: str = "") -> str:
    text = tables(ledger, organisation)
    if pair:
        text = text.replace("[ledger]\n", f'[ledger]\ntls_certificate = "{pair[0]}"\ntls_key = "{pair[1]}"\n')
    return text + more


def shows(ledger: Embedded, folder: pathlib.Path, organisation: int, pair: tuple | None) -> subprocess.CompletedProcess:
    file = folder / "operator.toml"
    file.write_text(config(ledger, organisation, pair).split("[[msp]]")[0])
    return subprocess.run([BIN / "ledgerline", "control", "--config", file, "show"], capture_output=True, text=True, timeout=TIMEOUT_S)


def lets_in(endpoint: str, pair: tuple | None) -> bool:
    """By TLS alone. A server refuses a certificate only after the client's side of the handshake is done."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    context.set_alpn_protocols(["h2"])
    if pair:
        context.load_cert_chain(*pair)
    host, port = endpoint.rsplit(":", 1)
    try:
        with socket.create_connection((host, int(port)), TIMEOUT_S) as plain, context.wrap_socket(plain) as tls:
            tls.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0")
            return len(tls.recv(9)) > 0
    except (ssl.SSLError, ConnectionError):
        return False


def test_each_endpoint_lets_nobody_in_without_a_certificate_of_its_authorities(ledger, tmp_path):
    outsider = outsiders_pair(tmp_path)
    for endpoint in ledger.ready["peers"]:
        assert not lets_in(endpoint, None) and not lets_in(endpoint, outsider) and not lets_in(endpoint, tls_pair(ledger, 3))
        assert lets_in(endpoint, tls_pair(ledger, 1)) and lets_in(endpoint, own_pair(ledger, 1))


def test_a_program_with_a_certificate_reads_and_one_without_is_refused(ledger, tmp_path):
    for pair in (tls_pair(ledger, 1), own_pair(ledger, 1)):
        shown = shows(ledger, tmp_path, 1, pair)
        assert shown.returncode == 0 and "tello1" in shown.stdout, shown.stderr
    for pair in (None, outsiders_pair(tmp_path)):
        shown = shows(ledger, tmp_path, 1, pair)
        assert shown.returncode == 1 and "tello1" not in shown.stdout, shown.stdout


def test_doctor_names_what_is_wrong_with_a_certificate_of_tls(ledger, tmp_path):
    folder = tmp_path / "etc"
    folder.mkdir()
    drone = '[[drone]]\nname = "tello1"\n[dds]\nlocal_only = true\n'

    def broken(pair: tuple | None) -> dict:
        (folder / "ground.toml").write_text(config(ledger, 2, pair, drone))
        done = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", folder, "--json"], capture_output=True, text=True,
                              timeout=TIMEOUT_S)
        return {problem: each for problem, each in findings.of_doctor(done).items() if each["verdict"] == "broken"}

    good, outsider = tls_pair(ledger, 2), outsiders_pair(tmp_path)
    assert not broken(good)
    assert set(broken(None)) == {"tls_client_certificate"}
    assert set(broken(outsider)) == set(broken(own_pair(ledger, 2))) == {"tls_pair_refused"}
    assert set(broken((good[0], outsider[1]))) == {"tls_pair_wrong"}
    assert set(broken((tmp_path / "none.pem", outsider[1]))) == {"tls_pair_wrong"}
    copied = tmp_path / "open.key"
    copied.write_text(good[1].read_text())
    copied.chmod(0o644)
    found = broken((good[0], copied))
    assert set(found) == {"key_open"} and f"`chmod 600 {copied}`" in found["key_open"]["cure"], found
    copied.chmod(0o600)
    assert not broken((good[0], copied))


def test_an_endorser_answers_who_shows_a_certificate_of_its_authority_and_nobody_else(ledger, endorser, tmp_path):
    def asks(endpoint: str, pair: tuple | None, deadline_ms: int) -> subprocess.CompletedProcess:
        file = tmp_path / "host.toml"
        text = config(ledger, 1, pair).split("[[msp]]")[0].replace(ledger.endpoint, endpoint)
        file.write_text(f"{text}deadline_ms = {deadline_ms}\n")
        return subprocess.run([BIN / "test_ask_peer", "--config", file, "get", "control/tello1"], capture_output=True, text=True,
                              timeout=TIMEOUT_S)

    for pair in (None, outsiders_pair(tmp_path), tls_pair(ledger, 2)):
        assert not lets_in(endorser.endpoint, pair)
        refused = asks(endorser.endpoint, pair, 500)
        assert refused.returncode == 1 and not refused.stdout and refused.stderr, refused
    assert lets_in(endorser.endpoint, tls_pair(ledger, 1))
    answered = asks(endorser.endpoint, tls_pair(ledger, 1), 20_000)
    assert answered.returncode == 0, answered
    assert json.loads(answered.stdout) == json.loads(asks(ledger.endpoint, tls_pair(ledger, 1), 20_000).stdout), "as the peer answers"


def test_doctor_names_whose_certificate_an_endorser_does_not_take(ledger, endorser, tmp_path):
    folder = tmp_path / "etc"
    folder.mkdir()

    def broken(own: tuple | None, shown: tuple | None) -> set[str]:
        """What is wrong with the endorser: `own` is of [ledger], `shown` of [[endorser]], for which without it the other one counts."""
        table = f'[[endorser]]\nmsp_id = "Org1MSP"\nendpoint = "{endorser.endpoint}"\ntls_ca = "{ledger.ca_file(1)}"\n'
        if shown:
            table += f'tls_certificate = "{shown[0]}"\ntls_key = "{shown[1]}"\n'
        (folder / "ground.toml").write_text(config(ledger, 2, own, f'{table}[[drone]]\nname = "tello1"\n[dds]\nlocal_only = true\n'))
        done = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", folder, "--json"], capture_output=True, text=True,
                              timeout=TIMEOUT_S)
        return {check["problem"] for check in json.loads(done.stdout)["checks"]
                if check["verdict"] == "broken" and endorser.endpoint in check["what"]}

    assert broken(None, None) == {"tls_client_certificate"}
    assert broken(tls_pair(ledger, 2), None) == broken(tls_pair(ledger, 2), outsiders_pair(tmp_path)) == {"tls_pair_refused"}
    assert not broken(tls_pair(ledger, 2), tls_pair(ledger, 1))


def test_the_bridge_reads_blocks_with_a_certificate_and_none_without(ledger, tmp_path):
    operator = tmp_path / "operator.toml"
    operator.write_text(config(ledger, 2, tls_pair(ledger, 2)).split("[[msp]]")[0])

    def reads_blocks(name: str, pair: tuple | None, within_s: float) -> bool:
        """While blocks come: it keeps the newest one that it has read."""
        file, checkpoint = tmp_path / f"{name}.toml", tmp_path / f"{name}.checkpoint"
        file.write_text(config(ledger, 1, pair, f'[output]\ncheckpoint = "{checkpoint}"\n[dds]\nlocal_only = true\n[[topic]]\n'
                                                'name = "/notes"\ntype = "std_msgs/msg/String"\nfrom = "*"\n'))
        bridge = subprocess.Popen([BIN / "ledgerline-bridge", file], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                  preexec_fn=die_with_parent)
        try:
            until = time.monotonic() + within_s
            while not checkpoint.exists() and time.monotonic() < until:
                for word in ("acquire", "release"):
                    subprocess.run([BIN / "ledgerline", "control", "--config", operator, word, "tello1"], check=True, timeout=TIMEOUT_S)
                assert bridge.poll() is None
            return checkpoint.exists()
        finally:
            bridge.terminate()
            bridge.wait(TIMEOUT_S)

    assert reads_blocks("with", tls_pair(ledger, 1), TIMEOUT_S)
    assert not reads_blocks("without", None, 2)


@pytest.mark.parametrize("source", ["peer", "orderer"])
def test_fabrics_own_program_reads_blocks_by_the_certificate_that_it_shows(ledger, tmp_path, source):
    """Each request names the certificate's hash: the node's unit tests have those that name another."""
    needs_fabric()
    certificate, key = tls_pair(ledger, 1)
    peer = Peer(ledger.directory, ledger.endpoint, 1, ledger.endpoint, ca_files=(ledger.ca_file(1), ledger.ca_file(1)))
    peer.environment |= {"CORE_PEER_TLS_CLIENTAUTHREQUIRED": "true", "CORE_PEER_TLS_CLIENTCERT_FILE": str(certificate),
                         "CORE_PEER_TLS_CLIENTKEY_FILE": str(key)}
    ordering = [*peer.ordering, "--clientauth", "--certfile", certificate, "--keyfile", key] if source == "orderer" else []
    fetched = peer.run("channel", "fetch", "0", tmp_path / "first.block", "-c", "teleop", *ordering)
    assert fetched.returncode == 0 and (tmp_path / "first.block").stat().st_size > 0, fetched.stderr


def test_an_authority_that_cannot_be_read_is_named_before_anything_starts(ledger, tmp_path):
    wrong = tmp_path / "wrong.pem"
    wrong.write_text("no certificate")
    for file in (wrong, tmp_path / "none.pem"):
        done = subprocess.run([BIN / "ledgerline-node", "--dir", tmp_path / "new", "--listen", "127.0.0.1:0", "--tls-client-ca", file],
                              capture_output=True, text=True, timeout=TIMEOUT_S)
        assert done.returncode == 2 and str(file) in done.stderr and not (tmp_path / "new").exists(), done.stderr
