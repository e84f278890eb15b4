"""chaincode/shim, by its example (counters), as a service of two real peers."""
import hashlib
import io
import json
import os
import re
import subprocess
import tarfile
import time

import pytest
from cli import good, peer_of, query
from fabric import BIN, needs_fabric
from ledgers import CUTTING, Fabric
from official import Node, call, decode

PACKAGE, KEEPALIVE_S = "counter_1", 1


class Counter:
    """The example in a process of its own: it may end and come again, as may the peers."""

    def __init__(self, ledger: Fabric, directory):
        self.log_file = directory / "counter.log"
        home, peer = ledger.organisation(1), ledger.organisation(1) / "peers" / "peer0.org1.ledgerline" / "tls"
        self.tls = {"CHAINCODE_TLS_KEY": home / "chaincode" / "tls" / "server.key",
                    "CHAINCODE_TLS_CERT": home / "chaincode" / "tls" / "server.crt",
                    "CHAINCODE_TLS_CLIENT_CA": directory / "peers_ca.crt"}
        # Each peer calls with its own pair, and this service has peers of two organisations.
        (directory / "peers_ca.crt").write_text("".join(
            (ledger.organisation(k) / "peers" / f"peer0.org{k}.ledgerline" / "tls" / "ca.crt").read_text() for k in (1, 2)))
        self.connection = {
            "dial_timeout": "10s", "tls_required": True, "root_cert": (peer / "ca.crt").read_text(),
            "client_auth_required": True}  # the peer's builder puts in the peer's own pair
        self.address, self.package_id = "127.0.0.1:0", "not known yet"
        self.start()

    def start(self) -> None:
        with open(self.log_file, "wb") as log:
            self.process = subprocess.Popen(
                [BIN / "shim_example"], stdout=log, stderr=log,
                env={**os.environ, **self.tls, "CHAINCODE_ID": self.package_id, "CHAINCODE_SERVER_ADDRESS": self.address})
        while not (line := re.match(r"(\S+:\d+)\n", self.log())):
            assert self.process.poll() is None, self.log()
            time.sleep(0.02)
        self.address = line[1]

    def stop(self) -> None:
        self.process.terminate()
        assert self.process.wait(timeout=20) == 0, self.log()

    def log(self) -> str:
        return self.log_file.read_text()

    def connections(self) -> int:
        return len(re.findall(r"peer \S+ connected", self.log()))

    def package(self) -> bytes:
        connection = json.dumps({**self.connection, "address": self.address})
        return archive({"metadata.json": json.dumps({"type": "ccaas", "label": PACKAGE}).encode(),
                        "code.tar.gz": archive({"connection.json": connection.encode()})})


def archive(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as tar:
        for name, content in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))
    return out.getvalue()


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    needs_fabric()
    os.environ["CORE_CHAINCODE_KEEPALIVE"] = str(KEEPALIVE_S)  # of the peers: how often they ask the chaincode
    running = Fabric(tmp_path_factory.mktemp("network") / "net", *CUTTING)
    del os.environ["CORE_CHAINCODE_KEEPALIVE"]
    yield running
    assert running.stop() == 0, running.log()


@pytest.fixture(scope="module")
def counter(network, tmp_path_factory):
    """Deployed with Fabric's own command line on the peers of two organisations."""
    home = tmp_path_factory.mktemp("counter")
    process = Counter(network, home)
    package = home / "counter.tgz"
    package.write_bytes(process.package())
    package_id = f"{PACKAGE}:{hashlib.sha256(package.read_bytes()).hexdigest()}"
    process.stop()
    process.package_id = package_id
    process.start()
    admins = [peer_of(network, number, "Admin") for number in (1, 2)]
    definition = ("--channelID", "teleop", "--name", "counter", "--version", "1", "--sequence", "1",
                  "--signature-policy", "OR('Org1MSP.peer','Org2MSP.peer')")
    for admin in admins:
        good(admin, "lifecycle", "chaincode", "install", package)
        good(admin, "lifecycle", "chaincode", "approveformyorg", "--package-id", package_id, *admin.ordering, *definition)
    targets = [part for number in (1, 2) for endpoint, ca_file in [network.peer(number)]
               for part in ("--peerAddresses", endpoint, "--tlsRootCertFiles", ca_file)]
    good(admins[0], "lifecycle", "chaincode", "commit", *admins[0].ordering, *definition, *targets)
    yield process
    process.stop()


@pytest.fixture(scope="module")
def client(network, node_modules):
    node = Node(node_modules, network)
    yield node.user(1, "User1")
    node.close()


def submit(client, fn: str, *args: str) -> str:
    answer = client.call("submit", fn, *args, contract="counter")
    assert answer.get("successful"), answer
    return decode(answer["result"]).decode()


def evaluate(client, fn: str, *args: str) -> str:
    answer = client.call("evaluate", fn, *args, contract="counter")
    assert "result" in answer, answer
    return decode(answer["result"]).decode()


def test_a_range_and_a_history_longer_than_one_answer_of_the_peer(counter, client):
    keys = [f"k{number:03}" for number in range(230)]  # the peer gives 100 at a time
    assert submit(client, "add", *keys) == " ".join("1" for _ in keys)
    assert evaluate(client, "list").splitlines() == [f"{key}=1" for key in keys]
    for number in range(2, 5):
        assert submit(client, "add", "k000") == str(number)
    submit(client, "remove", "k000")
    assert evaluate(client, "past", "k000").splitlines() == ["removed", "4", "3", "2", "1"]
    assert evaluate(client, "list").splitlines() == [f"{key}=1" for key in keys[1:]]
    assert evaluate(client, "read", "k000") == "0"


def test_events_and_refusals_are_those_of_the_chaincode(counter, client):
    done = client.call("submit", "add", "reported", contract="counter")
    (event,) = client.ask("events", start=done["block"], count=1, contract="counter")["events"]
    assert (event["name"], decode(event["payload"]), event["tx"]) == ("added", b"1", done["tx"])
    refused = client.call("evaluate", "subtract", "reported", contract="counter")["error"]
    assert refused["details"] == ["chaincode response 500, unknown function subtract"]


def test_many_transactions_of_two_peers_run_at_once(network, counter, client):
    requests = [client.send("submit", **call("add", f"m{number}"), contract="counter") for number in range(60)]
    assert all(client.receive(request).get("successful") for request in requests)
    other = peer_of(network, 2, "User1")
    for number in range(3):
        read = query(other, "read", f"m{number}", contract="counter")
        assert read.returncode == 0 and read.stdout.strip() == "1", read.stderr
    assert counter.connections() == 2


def test_a_peer_that_asks_whether_it_is_there_keeps_its_stream(counter, client):
    before = counter.connections()
    time.sleep(2.5 * KEEPALIVE_S)
    submit(client, "add", "alive")
    assert counter.connections() == before


def test_chaincode_that_ends_and_comes_again_is_found_by_its_peers(counter, client):
    value = int(submit(client, "add", "again"))
    counter.stop()
    assert "error" in client.call("evaluate", "read", "again", contract="counter")
    counter.start()
    assert evaluate(client, "read", "again") == str(value)
    assert int(submit(client, "add", "again")) == value + 1


def test_peers_that_are_killed_and_come_again_are_served(network, counter, client):
    value = int(submit(client, "add", "peers"))
    before = counter.connections()
    network.kill()
    network.start()
    assert evaluate(client, "read", "peers") == str(value)
    assert counter.connections() > before
    assert counter.process.poll() is None
