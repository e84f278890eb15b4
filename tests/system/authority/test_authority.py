"""A network whose identities fabric-ca issued: members, revocation, a second start."""
import json
import os
import pathlib
import re
import shutil
import ssl
import stat
import subprocess
import time

import pytest
from fabric import FABRIC, Peer, fabric, needs_fabric
from programs import BIN, ask, organisation, user_msp

LONG = os.environ.get("LEDGERLINE_LONG") == "1"


def needs_ca() -> None:
    needs_fabric()
    if not (FABRIC / "ca.go.sum").exists():
        pytest.skip("fabric-ca is missing: scripts/fabric-tools --ca builds it (Go 1.24 or newer)")


def identity(*words) -> str:
    ran = subprocess.run([BIN / "ledgerline", "identity", *words], capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def of_authority(home: pathlib.Path) -> list:
    host, port = re.search(r"address: (\S+)\nport: (\d+)", (home / "fabric-ca-server-config.yaml").read_text()).groups()
    return ["--ca", f"https://{host}:{port}", "--ca-tls", home / "ca-cert.pem", "--program", FABRIC / "fabric-ca-client"]


def registered(home: pathlib.Path, name: str, folder: pathlib.Path) -> pathlib.Path:
    """At the authority by its registrar; returns the file with the secret."""
    options = dict(zip(*[iter(map(str, of_authority(home)))] * 2))
    done = subprocess.run([FABRIC / "fabric-ca-client", "register", "--id.name", name, "--id.type", "client",
                           "--id.maxenrollments", "1", "--id.secret", "a/b:c"], capture_output=True, text=True,
                          timeout=60, env={**os.environ, "FABRIC_CA_CLIENT_HOME": str(home / "registrar"),
                                           "FABRIC_CA_CLIENT_URL": options["--ca"],
                                           "FABRIC_CA_CLIENT_TLS_CERTFILES": options["--ca-tls"]})
    assert done.returncode == 0, done.stderr
    secret = folder / "secret"
    secret.write_text("a/b:c\n")
    secret.chmod(0o600)
    return secret


class Network:
    def __init__(self, directory: pathlib.Path):
        self.directory = directory

    def start(self, *options: str) -> None:
        self.process = subprocess.Popen(
            [BIN / "ledgerline", "fabric", "run", "--dir", self.directory, "--tools", FABRIC, *options],
            stdout=subprocess.PIPE, stderr=open(self.directory.with_suffix(".log"), "ab"), text=True)
        ready = self.process.stdout.readline()
        assert ready, self.log()
        self.endpoint, self.orderer = json.loads(ready)["endpoint"], json.loads(ready)["orderers"][0]

    def stop(self) -> int:
        self.process.terminate()
        return self.process.wait(timeout=60)

    def log(self) -> str:
        return self.directory.with_suffix(".log").read_text()

    def ask(self, number: int, user: str, *words: str) -> subprocess.CompletedProcess:
        return ask(self.endpoint, self.directory, number, user_msp(self.directory, number, user), *words)

    def good(self, number: int, user: str, *words: str) -> str:
        ran = self.ask(number, user, *words)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    def on_channel(self, channel: str, number: int, user: str, *words: str) -> subprocess.CompletedProcess:
        return ask(self.endpoint, self.directory, number, user_msp(self.directory, number, user), *words, channel=channel)

    def refused(self, number: int, user: str, *words: str) -> None:
        ran = self.ask(number, user, *words)
        assert ran.returncode == 1 and "access denied" in ran.stderr, ran.stdout + ran.stderr

    def peer_cli(self, user: str, *words: str) -> subprocess.CompletedProcess:
        """Fabric's own program at the first peer: what it asks the peer itself, not the channel."""
        home = organisation(self.directory, 1)
        return subprocess.run([FABRIC / "peer", *words], capture_output=True, text=True, timeout=60, env={
            **os.environ, "FABRIC_CFG_PATH": str(FABRIC / "config"), "CORE_PEER_ADDRESS": self.endpoint,
            "CORE_PEER_LOCALMSPID": "Org1MSP", "CORE_PEER_MSPCONFIGPATH": str(user_msp(self.directory, 1, user)),
            "CORE_PEER_TLS_ENABLED": "true",
            "CORE_PEER_TLS_ROOTCERT_FILE": str(home / "peers/peer0.org1.ledgerline/tls/ca.crt")})

    def revoke(self, number: int, user: str | None = None, certificate: pathlib.Path | None = None) -> subprocess.CompletedProcess:
        which = ["--user", user] if user else ["--certificate", certificate]
        return fabric("revoke", "--dir", self.directory, "--tools", FABRIC, "--org", str(number), *which)


def note(key: str, data: str = "") -> tuple[str, ...]:
    return "submit", "set", json.dumps({"id": key, "msgType": "t", "msgData": data})


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    needs_ca()
    running = Network(tmp_path_factory.mktemp("authority") / "net")
    # As a crash in the midst of issuing leaves it: authorities, and no identities.
    cut_off = running.directory / "ca" / "org1.ledgerline"
    cut_off.mkdir(parents=True)
    (cut_off / "ca-cert.pem").write_text("not a certificate")
    running.start("--ca", "--channel", "teleop", "--channel", "yard")
    yield running
    assert running.stop() == 0, running.log()


def test_secrets_are_their_owners_alone(network):
    assert stat.S_IMODE((network.directory / "ca").stat().st_mode) == 0o700
    keys = [*(network.directory / "crypto").rglob("priv_sk"), *(network.directory / "crypto").rglob("*.key"),
            *(network.directory / "ca").rglob("*_sk"), *(network.directory / "ca").glob("*/registrar.secret")]
    assert len(keys) > 40
    assert {stat.S_IMODE(key.stat().st_mode) for key in keys} == {0o600}
    assert not list((network.directory / "ca").glob("*/issuing")), "members' keys are where they belong alone"


def test_certificates_are_what_the_layout_says(network):
    def subject(path: pathlib.Path) -> dict:
        found = ssl._ssl._test_decode_cert(str(path))
        names = {key: value for part in found["subject"] for key, value in part}
        return names | {"sans": {value for _, value in found.get("subjectAltName", ())}}

    home = organisation(network.directory, 2)
    peer = subject(home / "peers/peer0.org2.ledgerline/msp/signcerts/peer0.org2.ledgerline-cert.pem")
    assert peer["commonName"] == "peer0.org2.ledgerline" and peer["organizationalUnitName"] == "peer"
    assert subject(home / "peers/peer0.org2.ledgerline/tls/server.crt")["sans"] >= {
        "peer0.org2.ledgerline", "localhost", "127.0.0.1"}
    admin = subject(next((user_msp(network.directory, 2, "Admin") / "signcerts").iterdir()))
    assert admin["organizationalUnitName"] == "admin" and admin["organizationName"] == "org2.ledgerline"
    orderer = network.directory / "crypto/ordererOrganizations/ledgerline/orderers/orderer.ledgerline"
    assert subject(next((orderer / "msp/signcerts").iterdir()))["organizationalUnitName"] == "orderer"


def test_members_write_and_read(network):
    network.good(1, "User1", *note("tello1/note"))
    assert json.loads(network.good(2, "User2", "evaluate", "get", "tello1/note"))["id"] == "tello1/note"


def test_certificates_that_are_no_members_are_refused(network, tmp_path):
    # Of the same CA, and of no role: the registrar's, which revokes, and those for TLS.
    found = {"registrar": network.directory / "ca" / "org1.ledgerline" / "registrar" / "msp"}
    home = organisation(network.directory, 1)
    for name, tls, kind in (("service", home / "chaincode/tls", "server"),
                            ("peer", home / "peers/peer0.org1.ledgerline/tls", "server"),
                            ("user", user_msp(network.directory, 1, "User1").parent / "tls", "client")):
        found[name] = tmp_path / name
        for folder, file, to in (("signcerts", f"{kind}.crt", "cert.pem"), ("keystore", f"{kind}.key", "priv_sk")):
            (found[name] / folder).mkdir(parents=True)
            shutil.copy2(tls / file, found[name] / folder / to)
    for name, msp in found.items():
        ran = ask(network.endpoint, network.directory, 1, msp, *note("Org1MSP/intruder"))
        assert ran.returncode == 1 and "access denied" in ran.stderr, name + ran.stdout + ran.stderr


def test_a_revoked_user_is_refused_and_what_it_wrote_stays(network):
    network.good(1, "User1", *note("tello1/last"))
    assert network.on_channel("yard", 1, "User1", "evaluate", "get").returncode == 0
    revoked = network.revoke(1, "User1")
    assert revoked.returncode == 0, revoked.stderr
    network.refused(1, "User1", *note("tello1/later"))
    network.refused(1, "User1", *note("Org1MSP/later"))
    elsewhere = network.on_channel("yard", 1, "User1", "evaluate", "get")
    assert elsewhere.returncode == 1 and "access denied" in elsewhere.stderr, "on every channel"
    network.good(1, "User2", *note("Org1MSP/others-go-on"))
    network.good(3, "User1", *note("Org3MSP/others-go-on"))
    history = network.good(2, "User1", "evaluate", "history", "tello1/last")
    assert "User1@org1.ledgerline" in history
    again = network.revoke(1, "User1")
    assert again.returncode == 0, again.stderr


def test_an_identity_is_enrolled_renewed_and_revoked_by_the_page(network, tmp_path):
    home = network.directory / "ca" / "org1.ledgerline"
    msp = tmp_path / "etc" / "msp"
    secret = registered(home, "raven", tmp_path)
    identity("enroll", "raven", *of_authority(home), "--secret-file", secret, "--subject", "O=org1.ledgerline", "--msp-dir", msp)
    assert {stat.S_IMODE(key.stat().st_mode) for key in (msp / "keystore").iterdir()} == {0o600}
    assert [file.name for file in msp.parent.iterdir()] == ["msp"], "nothing of the question stays"
    shown = json.loads(identity("status", "--msp-dir", msp, "--json"))["certificates"]
    assert shown[0]["subject"] == "CN=raven,OU=client,O=org1.ledgerline" and shown[0]["days"] > 3000, shown
    assert "CN=ca.org1.ledgerline" in shown[0]["issuer"] and shown[0]["problem"] == "", shown
    authorities = msp.parent / "authorities"
    authorities.mkdir()
    shutil.copy(organisation(network.directory, 2) / "ca/ca.org2.ledgerline-cert.pem", authorities / "Org2MSP.pem")
    foreign = subprocess.run([BIN / "ledgerline", "identity", "status", "--msp-dir", msp], capture_output=True, text=True, timeout=60)
    assert foreign.returncode == 1 and "no member of an organisation here" in foreign.stdout, foreign
    shutil.copy(organisation(network.directory, 1) / "ca/ca.org1.ledgerline-cert.pem", authorities / "Org1MSP.pem")
    assert json.loads(identity("status", "--msp-dir", msp, "--json"))["certificates"][0]["problem"] == ""

    def writes(key: str) -> subprocess.CompletedProcess:
        return ask(network.endpoint, network.directory, 1, msp, *note(f"Org1MSP/{key}"))

    assert writes("enrolled").returncode == 0, writes("enrolled").stderr
    before = {file: file.read_bytes() for file in msp.rglob("*") if file.is_file()}
    identity("renew", *of_authority(home), "--msp-dir", msp)
    assert {file: file.read_bytes() for file in msp.rglob("*") if file.is_file()} != before
    assert len(list((msp / "keystore").iterdir())) == 1 and writes("renewed").returncode == 0

    admin = Peer(network.directory, network.endpoint, 1, network.orderer, user="Admin")
    block, update = tmp_path / "newest.block", tmp_path / "org1.update"
    fetched = admin.run("channel", "fetch", "config", block, "-c", "teleop", *admin.ordering)
    assert fetched.returncode == 0, fetched.stderr
    identity("revoke", "raven", *of_authority(home), "--msp-dir", home / "registrar" / "msp", "--list", tmp_path / "org1.crl",
             "--config-block", block, "--msp-id", "Org1MSP", "--update", update)
    updated = admin.run("channel", "update", "-f", update, "-c", "teleop", *admin.ordering)
    assert updated.returncode == 0, updated.stderr
    deadline = time.monotonic() + 60  # the peer has the block a moment later
    while writes("revoked").returncode == 0 and time.monotonic() < deadline:
        time.sleep(0.1)
    refused = writes("revoked")
    assert refused.returncode == 1 and "access denied" in refused.stderr, refused.stdout + refused.stderr
    assert network.ask(1, "Admin", "evaluate", "get").returncode == 0


@pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1")
def test_one_certificate_is_revoked_and_the_renewed_one_of_its_owner_goes_on(network, tmp_path):
    home = network.directory / "ca" / "org1.ledgerline"
    msp, stolen = tmp_path / "etc" / "msp", tmp_path / "stolen"
    identity("enroll", "crow", *of_authority(home), "--secret-file", registered(home, "crow", tmp_path), "--subject", "O=org1.ledgerline",
             "--msp-dir", msp)
    shutil.copytree(msp, stolen)
    identity("renew", *of_authority(home), "--msp-dir", msp)

    def writes(whose: pathlib.Path) -> subprocess.CompletedProcess:
        return ask(network.endpoint, network.directory, 1, whose, *note("Org1MSP/crow"))

    assert writes(stolen).returncode == 0 and writes(msp).returncode == 0
    certificate = next((stolen / "signcerts").iterdir())
    elsewhere = network.revoke(2, certificate=certificate)
    assert elsewhere.returncode == 1 and "was not found" in elsewhere.stderr, "another organisation's authority knows it not"
    assert writes(stolen).returncode == 0
    for _ in range(2):  # it may be repeated
        revoked = network.revoke(1, certificate=certificate)
        assert revoked.returncode == 0 and str(certificate) in revoked.stdout, revoked.stderr
        refused = writes(stolen)
        assert refused.returncode == 1 and "access denied" in refused.stderr, refused.stdout + refused.stderr
        assert writes(msp).returncode == 0, "the owner goes on"
    identity("renew", *of_authority(home), "--msp-dir", msp)
    assert writes(msp).returncode == 0


def test_a_certificate_that_is_in_no_list_or_signs_for_all_is_not_revoked(network, tmp_path):
    home = organisation(network.directory, 1)
    of_tls = network.revoke(1, certificate=home / "users/User2@org1.ledgerline/tls/client.crt")
    assert of_tls.returncode == 1 and "no member's certificate" in of_tls.stderr, of_tls.stderr
    admins = network.revoke(1, certificate=next((user_msp(network.directory, 1, "Admin") / "signcerts").iterdir()))
    assert admins.returncode == 1 and "signs for its organisation" in admins.stderr, admins.stderr
    none = network.revoke(1, certificate=tmp_path / "none.pem")
    assert none.returncode == 2 and "none.pem" in none.stderr, none.stderr
    network.good(1, "Admin", "evaluate", "get")


def test_an_identity_that_cannot_be_revoked_is_reported(network):
    admin = network.revoke(1, "Admin")
    assert admin.returncode == 1 and "signs for its organisation" in admin.stderr
    nobody = network.revoke(1, "Nobody")
    assert nobody.returncode == 1 and "Nobody@org1.ledgerline was not found" in nobody.stderr
    network.good(1, "Admin", "evaluate", "get")


def test_a_second_start_goes_on_with_what_was_issued_and_revoked(network):
    def certificates() -> dict:
        return {path: path.read_bytes() for path in (network.directory / "crypto").rglob("*.pem")}

    assert network.revoke(1, "User1").returncode == 0
    before = certificates()
    assert network.stop() == 0, network.log()
    network.start("--channel", "teleop", "--channel", "yard")  # the directory knows that it has authorities
    assert certificates() == before
    network.refused(1, "User1", *note("Org1MSP/still-out"))
    deadline = time.monotonic() + 30  # the orderer is just electing itself its leader
    while network.ask(1, "User2", *note("Org1MSP/still-in")).returncode != 0 and time.monotonic() < deadline:
        time.sleep(0.2)
    network.good(1, "User2", "evaluate", "get", "Org1MSP/still-in")
    listed = network.peer_cli("User2", "channel", "list")
    assert listed.returncode == 0 and "teleop" in listed.stdout, listed.stderr
    listed = network.peer_cli("User1", "channel", "list")
    assert listed.returncode != 0 and "access denied" in listed.stderr, "the peer itself knows the list too"
    revoked = network.revoke(3, "User2")
    assert revoked.returncode == 0, revoked.stderr
    network.refused(3, "User2", *note("Org3MSP/out"))
    network.refused(1, "User1", *note("Org1MSP/still-out"))


def test_identities_of_another_origin_are_not_mixed(tmp_path):
    needs_ca()
    (tmp_path / "net" / "crypto").mkdir(parents=True)
    ran = subprocess.run([BIN / "ledgerline", "fabric", "run", "--dir", tmp_path / "net", "--tools", FABRIC, "--ca"],
                         capture_output=True, text=True, timeout=60)
    assert ran.returncode == 1 and "begin in an empty directory" in ran.stderr


def test_a_drone_flies_with_identities_of_fabric_ca(tmp_path):
    needs_ca()
    with open(tmp_path / "fly.out", "wb") as out:
        flown = subprocess.run([BIN / "ledgerline", "fly", "--ledger", "fabric", "--ca", "--laps", "1", "--out", tmp_path / "run",
                                "--json", tmp_path / "result.json"], stdout=out, stderr=subprocess.STDOUT, timeout=240)
    assert flown.returncode == 0, (tmp_path / "fly.out").read_text(errors="replace")
    report = json.loads((tmp_path / "result.json").read_text())
    assert report["ok"] is True and report["drones"][0]["commands"]["applied"] > 100
    assert (tmp_path / "run" / "ledger" / "ca" / "org1.ledgerline" / "ca-cert.pem").exists()
    assert os.listdir("/dev/shm") == []
