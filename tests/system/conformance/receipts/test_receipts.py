"""Receipts: made on either ledger, checked where there is no network, no config and no other file."""
import json
import pathlib
import shutil
import subprocess

import pytest
from fabric import BIN
from official import MVCC_READ_CONFLICT, asset, call

ORGANISATIONS = (1, 2, 3)
PROGRAM = BIN / "ledgerline-receipt"


def config(ledger, folder: pathlib.Path, organisation: int, peers=ORGANISATIONS) -> pathlib.Path:
    endpoint, ca = ledger.peer(organisation)
    path = folder / f"org{organisation}.toml"
    path.write_text(
        f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca}"\nmsp_id = "Org{organisation}MSP"\n'
        f'msp_dir = "{ledger.msp_dir(organisation, "User1")}"\n' + "".join(
            '[[endorser]]\nmsp_id = "Org{}MSP"\nendpoint = "{}"\ntls_ca = "{}"\n'.format(k, *ledger.endorser(k)) for k in peers))
    return path


class EmptyRoot:
    """A root with the program, what it is linked with, and the authorities' certificates: no network, no variable, no config."""

    def __init__(self, ledger, root: pathlib.Path):
        self.root = root
        root.mkdir()
        linked = subprocess.run(["ldd", PROGRAM], capture_output=True, text=True, check=True).stdout
        for library in (word for line in linked.splitlines() for word in line.split() if word.startswith("/")):
            copy = root / library[1:]
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(library, copy)
        shutil.copy(PROGRAM, root / "receipt")
        self.trust = ["--channel", "teleop"]
        for k in ORGANISATIONS:
            shutil.copy(ledger.organisation(k) / "ca" / f"ca.org{k}.ledgerline-cert.pem", root / f"org{k}.pem")
            self.trust += ["--organisation", f"Org{k}MSP=/org{k}.pem"]
        orderers = ledger.directory / "crypto" / "ordererOrganizations" / "ledgerline" / "ca" / "ca.ledgerline-cert.pem"
        shutil.copy(orderers, root / "orderers.pem")
        self.trust += ["--orderer", "OrdererMSP=/orderers.pem"]

    def verify(self, receipt: bytes, *words, trust=None) -> subprocess.CompletedProcess:
        (self.root / "one.receipt").write_bytes(receipt)
        return subprocess.run([shutil.which("unshare"), "--net", f"--root={self.root}", "--wd=/", "/receipt",
                               "--verify", "/one.receipt", *(self.trust if trust is None else trust), *words],
                              env={}, capture_output=True, text=True, timeout=60)

    def proven(self, receipt: bytes) -> dict:
        done = self.verify(receipt, "--json")
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout)


@pytest.fixture(scope="module")
def empty_root(ledger, tmp_path_factory) -> EmptyRoot:
    return EmptyRoot(ledger, tmp_path_factory.mktemp("empty") / "root")


def run(folder: pathlib.Path, *words) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *words], cwd=folder, capture_output=True, text=True, timeout=60)


def make(ledger, folder: pathlib.Path, transaction: str, **more) -> bytes:
    out = folder / "made.receipt"
    done = run(folder, "--config", config(ledger, folder, 2, **more), transaction, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    return out.read_bytes()


def test_a_valid_transaction_is_proven_in_an_empty_root(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    receipt = make(ledger, tmp_path, sent["tx"])
    proven = empty_root.proven(receipt)
    assert proven["proven"] and proven["verdict"] == "VALID" and proven["code"] == 0
    assert (proven["transaction"], proven["block"], proven["channel"]) == (sent["tx"], sent["block"], "teleop")
    assert [peer["msp_id"] for peer in proven["peers"]] == [f"Org{k}MSP" for k in ORGANISATIONS]
    assert proven["creator"]["msp_id"] == "Org1MSP" and "CN=User1@org1.ledgerline" in proven["creator"]["subject"]
    assert (proven["contract"], proven["function"], proven["arguments"]) == ("ledgerline", "set", 1)
    assert [orderer["msp_id"] for orderer in proven["orderers"]] == ["OrdererMSP"]
    words = empty_root.verify(receipt).stdout
    assert f"is in block {sent['block']} (" in words and "verdict: VALID, by the word of peers of 3 of 3 organisations" in words


def test_an_invalid_transaction_is_proven_invalid(tmp_path, ledger, enroll, operator, empty_root):
    enroll("receipted")
    operator.submit("stop", "receipted")
    late = operator.call("late", "stop", "receipted", between=call("resume", "receipted"))
    assert late["code"] == MVCC_READ_CONFLICT, late
    proven = empty_root.proven(make(ledger, tmp_path, late["tx"]))
    assert proven["verdict"] == "MVCC_READ_CONFLICT" and proven["function"] == "stop"
    assert proven["creator"]["msp_id"] == "Org2MSP"


def test_what_was_changed_or_is_too_little_proves_nothing(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    receipt = make(ledger, tmp_path, sent["tx"])
    for at in range(0, len(receipt), len(receipt) // 40):
        changed = bytearray(receipt)
        changed[at] ^= 1
        done = empty_root.verify(bytes(changed))
        assert done.returncode == 1 and "nothing is proven: " in done.stderr and not done.stdout, (at, done)
    refused = empty_root.verify(receipt[:-1], "--json")
    assert refused.returncode == 1 and json.loads(refused.stdout) == {"proven": False, "why": "it is cut off or damaged"}
    lone = make(ledger, tmp_path, sent["tx"], peers=(2,))
    done = empty_root.verify(lone)
    assert done.returncode == 1 and "by peers of 1 of 3 organisations, which is no majority" in done.stderr


def test_only_who_checks_says_whom_to_believe(tmp_path, ledger, drone_host, empty_root):
    receipt = make(ledger, tmp_path, drone_host.submit("set", asset("tello1/receipt"))["tx"])
    trust = empty_root.trust
    other_channel = [word.replace("teleop", "other") for word in trust]
    assert "of channel teleop, not of other" in empty_root.verify(receipt, trust=other_channel).stderr
    swapped = [word.replace("org1.pem", "org3.pem") for word in trust]
    assert "its creator is nobody of the organisations that you named" in empty_root.verify(receipt, trust=swapped).stderr
    no_orderers = [word.replace("orderers.pem", "org1.pem") for word in trust]
    assert "no orderer that you named" in empty_root.verify(receipt, trust=no_orderers).stderr
    for too_little in (trust[:2], trust[2:], trust[:-2], []):
        assert empty_root.verify(receipt, trust=too_little).returncode == 2


def test_it_is_checked_before_it_is_written_where_that_is_asked_for(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    trust = [word.replace("=/", f"={empty_root.root}/") for word in empty_root.trust]
    done = run(tmp_path, "--config", config(ledger, tmp_path, 1, peers=(1, 2)), sent["tx"], *trust)
    assert done.returncode == 0 and "peers of 2 of 3 organisations" in done.stdout, done.stderr
    assert empty_root.proven((tmp_path / f"{sent['tx']}.receipt").read_bytes())["transaction"] == sent["tx"]
    lone = run(tmp_path, "--config", config(ledger, tmp_path, 1, peers=(1,)), sent["tx"], *trust, "--out", "lone")
    assert lone.returncode == 1 and "no majority" in lone.stderr and not (tmp_path / "lone").exists()


def test_there_is_none_of_what_is_not_on_the_ledger(tmp_path, ledger):
    done = run(tmp_path, "--config", config(ledger, tmp_path, 1), "ab" * 32)
    assert done.returncode == 1 and "ab" * 32 in done.stderr and not list(tmp_path.glob("*.receipt"))
    for words in ((), ("ab" * 32,), ("xyz", "--config", tmp_path / "org1.toml"), ("--verify", tmp_path / "none")):
        assert run(tmp_path, *words).returncode == 2, words
