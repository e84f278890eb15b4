"""`ledgerline audit` of both ledgers: from a peer, and from copies where there is no network; a channel that Fabric's own
client wrote, and one that was flown on."""
import json
import os
import pathlib
import random
import subprocess
import sys

import pytest
from fabric import needs_fabric
from flights import fly, no_flight_outlives_its_test, printed
from ledgers import Embedded, Fabric, tables
from programs import BIN

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "conformance"))
from cli import good, invoke, peer_of  # noqa: E402
from official import Node, asset  # noqa: E402

TIMEOUT_S = 120
CHANGES = 400 if os.environ.get("LEDGERLINE_LONG") == "1" else 40


def audit(*words, network: bool = True) -> subprocess.CompletedProcess:
    command = [BIN / "ledgerline", "audit", *map(str, words)]
    return subprocess.run(command if network else ["unshare", "-n", *command], capture_output=True, text=True,
                          timeout=TIMEOUT_S)


def audited(*words, network: bool = True) -> dict:
    """Of which nothing may be found."""
    done = audit(*words, "--json", "-", network=network)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


class Written:
    """A ledger on which Fabric's own client was at work."""

    def __init__(self, kind, folder: pathlib.Path):
        needs_fabric()
        self.ledger = kind(folder / "node")
        self.anchor = self.ledger.directory / "teleop.block"
        self.config = folder / "operator.toml"
        self.config.write_text(tables(self.ledger, 2).split("[[msp]]")[0].split("[[orderer]]")[0])
        host, operator, other = (peer_of(self.ledger, k, "User1") for k in (1, 2, 3))
        for user, words in ((operator, ("acquire", "tello1")), (operator, ("stop", "tello1")), (operator, ("clear_stop", "tello1")),
                            (host, ("set", json.dumps(asset("tello1/note")))), (operator, ("release", "tello1")),
                            (other, ("set", json.dumps(asset("Org3MSP/notes"))))):
            done = invoke(user, *words, more=("--waitForEvent",))
            assert done.returncode == 0 and "VALID" in done.stderr, done.stderr

    def stop_in(self, reported: dict) -> int:
        """The block with the stop."""
        return next(word for word in reported["drones"]["tello1"]["words"] if word["what"] == "stop")["when"]["block"]


@pytest.fixture(scope="module", params=[Embedded, Fabric], ids=lambda kind: kind.name)
def written(request, tmp_path_factory) -> Written:
    """What the tests below need of it is on it already."""
    written = Written(request.param, tmp_path_factory.mktemp("audit"))
    yield written
    assert written.ledger.stop() == 0, written.ledger.log()


class Copy:
    """A folder with every block, saved from the peer."""

    def __init__(self, written: Written, folder: pathlib.Path):
        self.folder = folder
        self.reported = audited("--config", written.config, "--save", folder)
        self.stop = written.stop_in(self.reported)

    def changed(self, folder: pathlib.Path, change, number: int | None = None) -> pathlib.Path:
        """Another copy, in which `change` was made to the bytes of one block: that of the stop, unless one is named."""
        for block in self.folder.iterdir():
            (folder / block.name).write_bytes(block.read_bytes())
        block = folder / f"{self.stop if number is None else number}.block"
        block.write_bytes(change(block.read_bytes()))
        return folder


@pytest.fixture(scope="module")
def copy(written, tmp_path_factory) -> Copy:
    return Copy(written, tmp_path_factory.mktemp("copy"))


def test_a_channel_that_another_client_wrote_is_as_it_must_be(written, tmp_path):
    page = tmp_path / "audit.html"
    reported = audited("--config", written.config, "--html", page)
    assert reported["ok"] and reported["transactions"] >= 7 and reported["endorsements"] >= reported["valid"] - reported["config_blocks"]
    assert reported["functions"]["acquire"] == reported["functions"]["stop"] == reported["functions"]["clear_stop"] == 1
    (held,) = reported["drones"]["tello1"]["holders"]
    assert held["who"] == "Org2MSP/User1@org2.ledgerline" and held["ended_by"].startswith("release by Org2MSP/")
    text = page.read_text()
    assert "Org2MSP/User1@org2.ledgerline" in text and "http" not in text.replace("http://www.w3.org/2000/svg", "")


def test_a_copy_gives_the_same_report_without_any_network(written, copy):
    here = audited("--blocks", copy.folder, "--anchor", written.anchor, network=False)
    assert {**here, "asked": copy.reported["asked"]} == copy.reported


def test_a_copy_without_an_anchor_is_not_trusted_in_silence(copy):
    refused = audit("--blocks", copy.folder)
    assert refused.returncode == 2 and "--trust-first-block" in refused.stderr
    taken = audit("--blocks", copy.folder, "--trust-first-block")
    assert taken.returncode == 0 and "NO TRUST ANCHOR" in taken.stdout


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_changed_copy_names_the_first_transaction_that_differs(written, copy, tmp_path, share):
    def change(block: bytes) -> bytes:
        data = block.index(b"\x12", 70)  # behind the header: number and two hashes
        at = data + 8 + int(share * 2_000)
        return block[:at] + bytes([block[at] ^ 1]) + block[at + 1:]

    done = audit("--blocks", copy.changed(tmp_path, change), "--anchor", written.anchor)
    assert done.returncode == 1, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith(f"first difference: block {copy.stop}, transaction 0"), done.stdout


def test_a_flag_that_hides_a_stop_is_found(written, copy, tmp_path):
    def change(block: bytes) -> bytes:
        flags = block.rindex(b"\x0a\x01\x00")  # the one transaction's: VALID
        return block[:flags] + b"\x0a\x01\x0a" + block[flags + 3:]

    done = audit("--blocks", copy.changed(tmp_path, change), "--anchor", written.anchor)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "its flag is ENDORSEMENT_POLICY_FAILURE, but it is VALID" in done.stdout


def fields(message: bytes, begin: int, end: int):
    """(number, where its content begins, where it ends) of each length-delimited field: blocks have no others on their outside."""
    def varint(at: int) -> tuple[int, int]:
        value = shift = 0
        while True:
            byte = message[at]
            value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                return value, at
    while begin < end:
        key, at = varint(begin)
        size, at = varint(at)
        begin = at + size
        yield key >> 3, at, begin


def test_each_changed_byte_of_header_data_or_signatures_is_found(written, copy, tmp_path):
    random.seed(20)
    copy.changed(tmp_path, bytes)
    for _ in range(CHANGES):
        number = random.randrange(copy.reported["blocks"])
        path = tmp_path / f"{number}.block"
        block = path.read_bytes()
        parts = {field: (begin, end) for field, begin, end in fields(block, 0, len(block))}  # header, data, metadata
        _, *signatures = next(fields(block, *parts[3]))
        begin, end = random.choice([place for place in (parts[1], parts[2], tuple(signatures)) if place[0] < place[1]])
        at = random.randrange(begin, end)
        path.write_bytes(block[:at] + bytes([block[at] ^ random.randrange(1, 256)]) + block[at + 1:])
        done = audit("--blocks", tmp_path, "--anchor", written.anchor)
        assert done.returncode == 1, f"block {number}, byte {at}: {done.stdout}{done.stderr}"
        assert f"\nfirst difference: block {number}" in done.stdout, f"block {number}, byte {at}: {done.stdout}"
        path.write_bytes(block)
    assert audit("--blocks", tmp_path, "--anchor", written.anchor).returncode == 0


@pytest.mark.parametrize("number", [0, 2])
def test_a_missing_block_is_found(written, copy, tmp_path, number):
    (copy.changed(tmp_path, bytes) / f"{number}.block").unlink()
    done = audit("--blocks", tmp_path, "--anchor", written.anchor)
    assert done.returncode == 1 and f"first difference: block {number}:" in done.stdout, done.stdout + done.stderr


def test_deleted_last_blocks_are_found_by_the_newest_hash(written, copy, tmp_path):
    (copy.changed(tmp_path, bytes) / f"{copy.reported['newest_block']}.block").unlink()
    blind = audit("--blocks", tmp_path, "--anchor", written.anchor)
    assert blind.returncode == 0 and f"up to block {copy.reported['newest_block'] - 1} (hash " in blind.stdout.splitlines()[-1]
    done = audit("--blocks", tmp_path, "--anchor", written.anchor, "--newest", copy.reported["newest_hash"])
    assert done.returncode == 1 and f"not {copy.reported['newest_hash']}" in done.stdout.splitlines()[-1], done.stdout + done.stderr
    assert audit("--blocks", tmp_path, "--anchor", written.anchor, "--newest", "12ab").returncode == 2


def test_the_official_node_client_is_read_as_well(written):
    modules = pathlib.Path(os.environ.get("LEDGERLINE_NPM", "")) / "node_modules"
    if not (modules / "@hyperledger" / "fabric-gateway").is_dir():
        pytest.skip("its packages are missing: ./run-tests fetches them")
    node = Node(modules, written.ledger)
    try:
        sent = node.user(1, "User1").submit("set", asset("tello1/official"))
        refused = node.user(2, "User1").call("evaluate", "set", asset("tello1/official"))
    finally:
        node.close()
    reported = audited("--config", written.config)
    assert "error" in refused and reported["ok"] and reported["blocks"] > sent["block"]


def test_what_peer_fetches_is_a_copy_too(written, copy, tmp_path):
    peer = peer_of(written.ledger, 1, "User1")
    for number in range(copy.reported["blocks"]):
        good(peer, "channel", "fetch", number, tmp_path / f"{number}.block", "-c", "teleop")
    reported = audited("--blocks", tmp_path, "--anchor", written.anchor, network=False)
    assert reported["newest_hash"] == copy.reported["newest_hash"]


def test_bad_usage_is_reported_apart_from_findings(tmp_path):
    assert audit().returncode == 2
    assert audit("--blocks", tmp_path, "--trust-first-block").returncode == 2, "an empty folder"
    help_text = audit("--help")
    assert help_text.returncode == 0 and len(help_text.stdout.splitlines()) <= 48 and "Exit codes" in help_text.stdout


def test_a_flight_is_reported_from_its_ledger_alone(tmp_path):
    flight = fly(tmp_path / "flight", "--laps", "1", "--side", "1")
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path / "flight")
    run = tmp_path / "flight" / "run"
    reported = audited("--blocks", run / "ledger" / "ledger", "--anchor", run / "ledger" / "teleop.block", "--html",
                   tmp_path / "page.html", network=False)
    assert list(reported["drones"]) == ["tello1"], "a flight's ledger enrols what is flown"
    drone = reported["drones"]["tello1"]
    assert reported["ok"] and drone["poses"] > 100 and len(drone["path"]) > 100
    (commands,) = drone["commands"]
    assert commands["who"].startswith("Org2MSP/") and commands["valid"] > 100
    assert {"take-off", "landing"} <= {word["what"] for word in drone["words"]}
    assert [t["phase"] for t in drone["failsafe"]][-1] == "landed" and drone["failsafe_missing"] == 0
    assert drone["two_way_ms"]["count"] > 50 and 0 < drone["two_way_ms"]["median"] < 500
