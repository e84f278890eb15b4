"""One suite, two ledgers: each test runs on the embedded node and on Fabric itself; where they differ, Fabric is right."""
import os
import pathlib
import shutil
import subprocess

import pytest
from cli import peer_of
from fabric import Peer, needs_fabric
from ledgers import CUTTING, Authority, Embedded, Fabric
from official import HERE, Client, Node


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


@pytest.fixture(scope="session", params=[Embedded, Fabric], ids=lambda kind: kind.name)
def ledger(request, tmp_path_factory):
    """One of each for all tests: they keep apart by the names of their drones and assets."""
    if request.param is Fabric:
        needs_fabric()
    running = request.param(tmp_path_factory.mktemp("ledger") / "node", *CUTTING)
    yield running
    assert running.stop() == 0, running.log()


@pytest.fixture(scope="session")
def node(node_modules, ledger):
    process = Node(node_modules, ledger)
    yield process
    process.close()


@pytest.fixture(scope="session")
def drone_host(node) -> Client:
    """Owns tello1 to tello16."""
    return node.user(1, "User1")


@pytest.fixture(scope="session")
def operator(node) -> Client:
    return node.user(2, "User1")


@pytest.fixture(scope="session")
def nobody(node) -> Client:
    """A member that nothing is enrolled to."""
    return node.user(3, "User2")


@pytest.fixture(scope="session")
def admin(node):
    """The administrator of an organisation."""
    return lambda organisation: node.user(organisation, "Admin")


@pytest.fixture(scope="session")
def authority(ledger, tmp_path_factory) -> Authority:
    """The CA of the first organisation."""
    return Authority(ledger, 1, tmp_path_factory.mktemp("ca") / "org1")


@pytest.fixture(scope="session")
def peer(ledger) -> Peer:
    """Fabric's command line, as the drone host; the program is Fabric's, whichever ledger it asks."""
    needs_fabric()
    return peer_of(ledger, 1, "User1")


@pytest.fixture(scope="session")
def enroll(node, admin):
    """Enrolls new drones to Org1's User1 and lets Org2 fly them; makes a user of an organisation an operator or a
    supervisor."""
    def enroll_one(*drones: str, organisation: int = 1, user: str = "User1", role: str | None = None) -> Client:
        client = node.user(organisation, user)
        who = {"mspId": f"Org{organisation}MSP", "subject": subject(organisation, user)}
        admin(organisation).submit("enroll", {"identity": who, "drones": drones, **({"role": role} if role else {})})
        if drones:
            may = {"to": {"mspId": "Org2MSP"}, "fly": True, "maxPriority": 999_999_999}
            admin(1).submit("grant", {"drones": drones, "grant": may})
        return client
    return enroll_one


def subject(organisation: int, user: str) -> str:
    return (f"CN={user}@org{organisation}.ledgerline,OU={'admin' if user == 'Admin' else 'client'},"
            f"O=org{organisation}.ledgerline")
