"""A running ledgerline-node, or Fabric itself, and Fabric's official Node.js client."""
import base64
import json
import os
import pathlib
import resource
import shutil
import signal
import subprocess

import pytest
from fabric import FABRIC, needs_fabric

HERE = pathlib.Path(__file__).parent
BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])


@pytest.fixture(scope="session")
def node_modules(tmp_path_factory) -> pathlib.Path:
    """The pinned packages; fetched here unless ./run-tests has done so already."""
    home = pathlib.Path(os.environ.get("LEDGERLINE_NPM") or tmp_path_factory.mktemp("npm"))
    modules = home / "node_modules"
    if not (modules / "@hyperledger" / "fabric-gateway").is_dir():
        if shutil.which("npm") is None:
            pytest.skip("npm is missing: the official client needs Node.js 20.9 or newer")
        home.mkdir(parents=True, exist_ok=True)
        for name in ("package.json", "package-lock.json"):
            (home / name).write_bytes((HERE / name).read_bytes())
        subprocess.run(["npm", "ci", "--ignore-scripts", "--no-fund", "--no-audit"], cwd=home, check=True)
    return modules


class Ledger:
    """ledgerline-node in a directory of its own; may be stopped, killed and started again."""

    def __init__(self, directory: pathlib.Path, *options: str, file_limit: int | None = None):
        self.directory = directory
        self.options = options
        self.file_limit = file_limit  # bytes that a file may have: a disk that is full, for this process alone
        self.process = None
        self.start()

    def start(self) -> None:
        log = open(self.directory.with_suffix(".log"), "ab")
        self.process = subprocess.Popen(
            [BIN / "ledgerline-node", "--dir", self.directory, "--listen", "127.0.0.1:0",
             "--summary", self.directory.with_suffix(".json"), *self.options],
            stdout=subprocess.PIPE, stderr=log, text=True, preexec_fn=self.limit)
        ready = self.process.stdout.readline()
        assert ready, self.log()
        self.endpoint = json.loads(ready)["endpoint"]

    def limit(self) -> None:
        if self.file_limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.file_limit, self.file_limit))

    def stop(self, how=signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(how)
        return self.process.wait(timeout=20)

    def log(self) -> str:
        return self.directory.with_suffix(".log").read_text()

    def summary(self) -> dict:
        return json.loads(self.directory.with_suffix(".json").read_text())

    def organisation(self, number: int) -> pathlib.Path:
        return self.directory / "crypto" / "peerOrganizations" / f"org{number}.ledgerline"


class Fabric:
    """A real Fabric network with our contract on it; what tests want of a Ledger."""

    def __init__(self, directory: pathlib.Path):
        self.directory = directory
        self.process = subprocess.Popen(
            [BIN / "ledgerline-fabric", "run", "--dir", directory, "--tools", FABRIC],
            stdout=subprocess.PIPE, stderr=open(directory.with_suffix(".log"), "ab"), text=True)
        ready = self.process.stdout.readline()
        assert ready, self.log()
        self.endpoint = json.loads(ready)["endpoint"]

    def stop(self) -> int:
        self.process.terminate()
        return self.process.wait(timeout=60)

    def log(self) -> str:
        return self.directory.with_suffix(".log").read_text()

    def organisation(self, number: int) -> pathlib.Path:
        return self.directory / "crypto" / "peerOrganizations" / f"org{number}.ledgerline"


class Client:
    """The official client, as one user."""

    def __init__(self, modules: pathlib.Path, ledger: Ledger, organisation: int, user: str):
        home = ledger.organisation(organisation)
        self.process = subprocess.Popen(
            ["node", HERE / "client.cjs", ledger.endpoint,
             ledger.organisation(1) / "tlsca" / "tlsca.org1.ledgerline-cert.pem", f"Org{organisation}MSP",
             home / "users" / f"{user}@org{organisation}.ledgerline" / "msp", "teleop", "ledgerline"],
            env={**os.environ, "NODE_PATH": str(modules)}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def send(self, op: str, **request) -> None:
        self.process.stdin.write(json.dumps({"op": op, **request}) + "\n")
        self.process.stdin.flush()

    def receive(self) -> dict:
        return json.loads(self.process.stdout.readline())

    def ask(self, op: str, **request) -> dict:
        self.send(op, **request)
        return self.receive()

    def call(self, op: str, fn: str, *args, **more) -> dict:
        return self.ask(op, fn=fn, args=[encode(arg) for arg in args], **more)

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=20)


def encode(arg) -> str:
    """Objects become JSON text, text and bytes stay what they are."""
    if isinstance(arg, dict):
        arg = json.dumps(arg)
    if isinstance(arg, str):
        arg = arg.encode()
    return base64.b64encode(arg).decode()


def decode(text: str) -> bytes:
    return base64.b64decode(text)


@pytest.fixture(scope="module", params=["embedded", "fabric"])
def ledger(request, tmp_path_factory):
    """One suite, two ledgers: where they differ, Fabric is right."""
    directory = tmp_path_factory.mktemp("ledger") / "node"
    if request.param == "fabric":
        needs_fabric()
    running = Ledger(directory) if request.param == "embedded" else Fabric(directory)
    yield running
    assert running.stop() == 0, running.log()


@pytest.fixture(scope="module")
def connect(node_modules, ledger):
    clients = []

    def open_client(organisation: int, user: str) -> Client:
        clients.append(Client(node_modules, ledger, organisation, user))
        return clients[-1]

    yield open_client
    for client in clients:
        client.close()


@pytest.fixture(scope="module")
def drone_host(connect):
    return connect(1, "User1")


@pytest.fixture(scope="module")
def operator(connect):
    return connect(2, "User1")
