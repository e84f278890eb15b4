"""Makes receipts, and checks them where there is no network, no config and no other file."""
import json
import pathlib
import shutil
import subprocess

import pytest
from fabric import BIN

ORGANISATIONS = (1, 2, 3)
PROGRAM = BIN.parent / "libexec/ledgerline/ledgerline-ledger"  # what `ledgerline receipt` runs


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
        return self.run("--verify", "/one.receipt", *(self.trust if trust is None else trust), *words)

    def verify_all(self, receipts: list[bytes]) -> tuple[int, list[dict]]:
        """In one process: its exit code, and what is proven of each."""
        folder = self.root / "all"
        folder.mkdir()
        names = [f"/all/{number:06}.receipt" for number in range(len(receipts))]
        for name, receipt in zip(names, receipts):
            (self.root / name[1:]).write_bytes(receipt)
        done = self.run("--json", "--verify", *names, *self.trust)
        shutil.rmtree(folder)
        said = [json.loads(line) for line in done.stdout.splitlines()]
        assert [one["file"] for one in said] == names, done.stderr
        return done.returncode, said

    def run(self, *words) -> subprocess.CompletedProcess:
        return subprocess.run([shutil.which("unshare"), "--net", f"--root={self.root}", "--wd=/", "/receipt", "receipt", *words],
                              env={}, capture_output=True, text=True, timeout=600)

    def proven(self, receipt: bytes) -> dict:
        done = self.verify(receipt, "--json")
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout)


@pytest.fixture(scope="module")
def empty_root(ledger, tmp_path_factory) -> EmptyRoot:
    return EmptyRoot(ledger, tmp_path_factory.mktemp("empty") / "root")


def run(folder: pathlib.Path, *words) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, "receipt", *words], cwd=folder, capture_output=True, text=True, timeout=60)


def make(ledger, folder: pathlib.Path, transaction: str, **more) -> bytes:
    out = folder / "made.receipt"
    done = run(folder, "--config", config(ledger, folder, 2, **more), transaction, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    return out.read_bytes()
