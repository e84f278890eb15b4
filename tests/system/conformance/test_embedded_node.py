"""What is about ledgerline-node alone: its files, its disk, its directory."""
import json
import subprocess

from fabric import BIN
from ledgers import Embedded
from official import Node, asset


def test_what_was_confirmed_is_counted_after_a_kill(tmp_path, node_modules):
    ledger = Embedded(tmp_path / "node", "--batch-count", "10", "--batch-timeout", "2")
    node = Node(node_modules, ledger)
    written = node.user(1, "User1").submit("set", asset("tello1/kept"))
    ledger.kill()
    ledger.start()
    assert node.user(1, "User1").submit("set", asset("tello1/more"))["block"] == written["block"] + 1
    node.close()
    assert ledger.stop() == 0
    assert ledger.summary()["transactions"] == 5
    assert ledger.summary()["invalid"] == 0


def test_keys_are_for_their_owner_only(tmp_path):
    ledger = Embedded(tmp_path / "node")
    keys = [path for path in ledger.directory.rglob("*") if path.name.endswith("_sk") or path.suffix == ".key"]
    assert len(keys) > 20
    assert {oct(path.stat().st_mode & 0o777) for path in keys} == {"0o600"}
    assert ledger.stop() == 0


def test_a_second_node_in_the_same_directory_is_refused(tmp_path):
    ledger = Embedded(tmp_path / "node")
    second = subprocess.run([BIN / "ledgerline-node", "--dir", ledger.directory, "--listen", "127.0.0.1:0"],
                            capture_output=True, text=True, timeout=20)
    assert second.returncode == 1 and "in use by another" in second.stderr
    assert ledger.stop() == 0


def test_a_node_whose_disk_takes_no_more_ends_and_loses_nothing_that_it_confirmed(tmp_path, node_modules):
    ledger = Embedded(tmp_path / "node", file_limit=400_000)
    node = Node(node_modules, ledger)
    host = node.user(1, "User1")
    confirmed = []
    for number in range(100):
        if "error" in host.call("submit", "set", asset(f"tello1/n{number}", bytes(10_000))):
            break
        confirmed.append(f"tello1/n{number}")
    assert 3 < len(confirmed) < 100
    assert ledger.process.wait(timeout=20) == 1
    assert "the ledger stops: writing" in ledger.log()

    ledger.file_limit = None
    ledger.start()
    assert "was not finished" in ledger.log()
    host = Node(node_modules, ledger).user(1, "User1")  # the old one may wait, as it was refused, before it tries again
    kept = json.loads(host.evaluate("get", "tello1/*"))["assets"]
    assert {one["id"] for one in kept} == set(confirmed)
    node.close()
    assert ledger.stop() == 0
