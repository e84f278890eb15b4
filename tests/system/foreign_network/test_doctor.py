"""What `ledgerline doctor` says of a real Fabric network, green and broken. One network for all: it is what costs time."""
import contextlib
import json
import os
import pathlib
import subprocess
import time

import findings
from bringing import bring_contract, consortium, enrol, ledger_file
from consortium import TIMEOUT_S, Consortium
from flights import BIN, control

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
DRONE = '[[drone]]\nname = "tello1"\nnumber = 1\n[dds]\nlocal_only = true\n'


class Host:
    """A folder with agent.toml of Org1's User1 and ground.toml of Org2's."""

    def __init__(self, network: Consortium, folder: pathlib.Path):
        self.folder = folder
        folder.mkdir()
        for k, name in ((1, "agent"), (2, "ground")):
            (folder / f"{name}.toml").write_text(ledger_file(network, k, "User1", whole=True).read_text() + DRONE)

    def doctor(self) -> dict:
        done = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", self.folder, "--json", "--timeout", "10"], capture_output=True,
                              text=True, timeout=2 * TIMEOUT_S)
        found = findings.of_doctor(done)
        print(json.dumps(found), flush=True)
        return found

    @contextlib.contextmanager
    def edited(self, name: str, old: str, new: str):
        path = self.folder / f"{name}.toml"
        text = path.read_text()
        assert old in text, f"{path} has no {old}"
        path.write_text(text.replace(old, new, 1))
        try:
            yield
        finally:
            path.write_text(text)


# What the host that the test runs on is like is not this test's subject.
OF_THE_HOST = {"clock_unsynchronised", "roudi_silent", "roudi_left", "roudi_replaced", "shm_small", "shm_not_writable", "roudi_group", "roudi_group_shared",
               "disk_low", "identity_ends", "not_running"}


def of_ledger(found: dict) -> set:
    return set(found) - OF_THE_HOST


def expired(network: Consortium, into: pathlib.Path) -> pathlib.Path:
    own, authority = network.users[1, "User1"], network.org1.ca
    request, certificate = into / "expired.csr", into / "expired.pem"
    for words in (["req", "-new", "-key", own / "msp/keystore/priv_sk", "-subj", "/O=org1.example.com/OU=client/CN=User1@org1.example.com",
                   "-out", request],
                  ["x509", "-req", "-in", request, "-CA", authority.certificate, "-CAkey", authority.key, "-CAcreateserial", "-days",
                   "-1", "-out", certificate]):
        subprocess.run(["openssl", *words], check=True, capture_output=True)
    return certificate


def tells_what_a_config_has_wrong(host: Host, network: Consortium, scratch: pathlib.Path) -> None:
    org1, org2 = network.organisations
    with host.edited("agent", 'timeouts = "auto"', "deadline_ms = 1000"):
        late = host.doctor()
        assert "max_age_ms = 4500" in late["blocks_late"]["cure"] and 'timeouts = "auto"' in late["blocks_late"]["cure"]
    with host.edited("agent", f'server_name = "peer0.{org1.domain}"', 'server_name = "peer9.example.com"'):
        assert "tls_wrong_name" in host.doctor()
    with host.edited("ground", str(org2.tlsca.root.certificate), str(org1.tlsca.root.certificate)):
        assert "tls_wrong_authority" in host.doctor()
    own = network.users[1, "User1"]
    with host.edited("agent", f'tls_certificate = "{own}/tls/server.crt"\ntls_key = "{own}/tls/server.key"\n', ""):
        assert "tls_client_certificate" in host.doctor()
    with host.edited("agent", str(own / "msp/signcerts/cert.pem"), str(expired(network, scratch))):
        assert "identity_expired" in host.doctor()


def tells_what_the_ledger_says(host: Host, network: Consortium) -> None:
    with host.edited("agent", 'contract = "drones"', 'contract = "others"'):
        assert "contract_missing" in host.doctor()
    with network.without("service1"):
        assert "ledgerline-chaincode" in host.doctor()["contract_silent"]["cure"]
        status = subprocess.run([BIN / "ledgerline", "contract", "status", "--config", ledger_file(network, 1, "Admin"), "--json"],
                                capture_output=True, text=True, timeout=2 * TIMEOUT_S)
        assert status.returncode == 1 and json.loads(status.stdout)["committed"]["service"]["answers"] is False, status
    operator, other = (ledger_file(network, 2, user) for user in ("User1", "Admin"))
    control(other, "enroll", "--msp", "Org2MSP", "--cert", network.users[2, "Admin"] / "msp/signcerts/cert.pem", "--role", "operator")
    control(other, "acquire", "tello1")
    control(operator, "stop", "tello1")
    assert of_ledger(host.doctor()) == {"lease_held", "stopped"}
    control(operator, "clear_stop", "tello1")
    control(other, "release", "tello1")
    assert of_ledger(host.doctor()) == set()


def tells_whose_signature_is_missing(host: Host, network: Consortium) -> None:
    """Two organisations, of which a majority is both: without Org2's peer nobody makes a record, however it is asked for."""
    agent = host.folder / "agent.toml"
    direct = agent.read_text()
    head, rest = direct.split("[[orderer]]", 1)
    with network.without("peer2"):
        found = host.doctor()["policy_unreachable"]
        assert "endorsed by Org1MSP, and the signature of Org2MSP is missing" in found["what"], found
        assert found["cure"].startswith("start the peer of Org2MSP"), found
        agent.write_text(head + "[[msp]]" + rest.split("[[msp]]", 1)[1])
        found = host.doctor()["policy_unreachable"]
        assert "the signature of Org2MSP is missing" in found["what"] and "start a peer of Org2MSP that has joined" in found["cure"], found
    ground = host.folder / "ground.toml"
    ground.rename(network.directory / "ground.toml")
    with network.without("orderer"):
        found = host.doctor()["port_closed"]
        assert f"localhost:{network.orderer_port} of channel" in found["what"] and "start the orderer" in found["cure"], found
    (network.directory / "ground.toml").rename(ground)
    for text in (agent.read_text(), direct):  # as the cure says: it is there again
        agent.write_text(text)
        deadline = time.monotonic() + TIMEOUT_S
        while left := of_ledger(host.doctor()):
            assert time.monotonic() < deadline, left
            time.sleep(1)


def test_doctor_on_a_real_network(tmp_path):
    with consortium(tmp_path / "network") as network:
        host = Host(network, tmp_path / "host")
        found = host.doctor()
        assert "contract_missing" in found and "blocks_late" not in found
        tells_what_a_config_has_wrong(host, network, tmp_path)
        if not LONG:
            return  # the contract, and a block of 2 s for each change, take a minute more
        bring_contract(network)
        enrol(network)
        assert of_ledger(host.doctor()) == set()
        tells_what_the_ledger_says(host, network)
        tells_whose_signature_is_missing(host, network)
