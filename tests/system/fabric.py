"""Fabric itself for tests: its programs, what its peers want of a test's network, and a network of our own on it."""
import json
import os
import pathlib
import subprocess
import time

import pytest
from netns import die_with_parent

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
FABRIC = pathlib.Path(os.environ["LEDGERLINE_FABRIC"])
TIMEOUT_S = 120  # not a limit on speed: only how long a broken test may take


def needs_fabric() -> None:
    if not (FABRIC / "go.sum").exists():
        pytest.skip("Fabric's programs are missing: scripts/fabric-tools builds them (Go 1.24 or newer)")
    # A peer does not start on a host that has no address but loopback's, though it uses no other.
    subprocess.run(["ip", "address", "replace", "10.255.255.1/32", "dev", "lo"], check=True)


def fabric(*words) -> subprocess.CompletedProcess:
    """`ledgerline fabric ...` to its end."""
    return subprocess.run([BIN / "ledgerline", "fabric", *words], capture_output=True, text=True, timeout=TIMEOUT_S)


def processes_in(directory: pathlib.Path) -> dict[str, dict]:
    """Of the network that runs there, by name."""
    done = fabric("status", "--dir", directory)
    assert done.returncode == 0, done.stdout + done.stderr
    return {process["name"]: process for process in json.loads(done.stdout)["processes"]}


def leader_in(directory: pathlib.Path, channel: str = "teleop") -> str:
    """The Raft leader; there may be none for a moment."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        for name, process in processes_in(directory).items():
            if channel in process.get("leads", []):
                return name
        time.sleep(0.1)
    raise AssertionError("no orderer leads")


class Network:
    """`ledgerline fabric run`, until stop()."""

    def __init__(self, directory: pathlib.Path, *options, command=lambda *words: list(words)):
        self.directory = directory
        self.summary = directory.with_suffix(".json")
        self.log_file = directory.with_suffix(".log")
        self.process = subprocess.Popen(
            command(BIN / "ledgerline", "fabric", "run", "--dir", directory, "--tools", FABRIC, "--summary", self.summary, *options),
            stdout=subprocess.PIPE, stderr=open(self.log_file, "ab"), text=True, preexec_fn=die_with_parent)

    def wait_ready(self) -> "Network":
        line = self.process.stdout.readline()
        assert line, self.log()
        self.ready = json.loads(line)
        return self

    def stop(self) -> None:
        self.process.terminate()
        assert self.process.wait(timeout=TIMEOUT_S) == 0, self.log()

    def log(self) -> str:
        return self.log_file.read_text()


def organisation_dir(directory: pathlib.Path, number: int) -> pathlib.Path:
    return directory / "crypto" / "peerOrganizations" / f"org{number}.ledgerline"


class Peer:
    """Fabric's own command line at a peer, as a user of an organisation."""

    def __init__(self, directory: pathlib.Path, address: str, organisation: int, orderer: str, user: str = "User1",
                 command=lambda *words: list(words), ca_files: tuple[pathlib.Path, pathlib.Path] | None = None, peers: list[str] = ()):
        """`ca_files`: of the TLS certificates of peer and orderer, where they are not those of their organisations. `peers`: of
        all organisations, for who invokes: its own endorses, and one of another."""
        home = organisation_dir(directory, organisation)
        ca_file, orderer_ca_file = ca_files or (
            home / "tlsca" / f"tlsca.org{organisation}.ledgerline-cert.pem",
            directory / "crypto/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem")
        self.command = command
        self.environment = {
            **os.environ, "FABRIC_CFG_PATH": str(FABRIC / "config"), "FABRIC_LOGGING_SPEC": "error", "CORE_PEER_ADDRESS": address,
            "CORE_PEER_LOCALMSPID": f"Org{organisation}MSP", "CORE_PEER_TLS_ENABLED": "true",
            "CORE_PEER_MSPCONFIGPATH": str(home / "users" / f"{user}@org{organisation}.ledgerline" / "msp"),
            "CORE_PEER_TLS_ROOTCERT_FILE": str(ca_file)}
        self.endorsers = [word for k in (organisation, 1 if organisation != 1 else 2) if peers
                          for word in ("--peerAddresses", peers[k - 1], "--tlsRootCertFiles",
                                       organisation_dir(directory, k) / "tlsca" / f"tlsca.org{k}.ledgerline-cert.pem")]
        self.ordering = ["-o", orderer, "--tls", "--cafile", orderer_ca_file]

    def run(self, *words) -> subprocess.CompletedProcess:
        return subprocess.run(self.command(FABRIC / "peer", *map(str, words)), env=self.environment, capture_output=True,
                              text=True, timeout=TIMEOUT_S)

    def invoke(self, channel: str, *arguments: str) -> None:
        """Returns when it is committed at this peer."""
        done = self.run("chaincode", "invoke", *self.ordering, *self.endorsers, "-C", channel, "-n", "ledgerline", "-c", json.dumps({"Args": arguments}),
                          "--waitForEvent")
        assert done.returncode == 0, done.stderr

    def query(self, channel: str, *arguments: str) -> str:
        """The answer, or what went wrong."""
        done = self.run("chaincode", "query", "-C", channel, "-n", "ledgerline", "-c", json.dumps({"Args": arguments}))
        return done.stdout if done.returncode == 0 else done.stderr

    def wait_for(self, channel: str, text: str, *arguments: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while text not in (answer := self.query(channel, *arguments)):
            assert time.monotonic() < deadline, answer
            time.sleep(0.1)
