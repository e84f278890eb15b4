"""A ledger, two DDS domains, a bridge for each, and peers in both that know nothing of them."""
import json
import os
import pathlib
import subprocess
import time

import peers
import pytest
from fabric import BIN, needs_fabric
from ledgers import Embedded, Fabric, tables
from netns import die_with_parent

TIMEOUT_S = 120  # not a limit on speed: only how long a broken test may take
os.environ["CYCLONEDDS_URI"] = peers.LAN  # of the bridges and of what cyclone.py makes


class Program:
    """One of ours with its config, which begins with [output]; says what it bridges."""

    def __init__(self, directory: pathlib.Path, name: str, command: list, config: str):
        self.status_file = directory / f"{name}.json"
        self.log_file = directory / f"{name}.log"
        file = directory / f"{name}.toml"
        file.write_text(f'[output]\nstatus = "{self.status_file}"\n{config}')
        self.process = subprocess.Popen([*command, file], stdout=subprocess.PIPE, stderr=open(self.log_file, "ab"), text=True,
                                        preexec_fn=die_with_parent)
        ready = self.process.stdout.readline()
        assert ready and json.loads(ready)["ready"], self.log()
        subprocess.Popen(["cat"], stdin=self.process.stdout, stdout=subprocess.DEVNULL)  # its status lines

    def status(self) -> dict:
        """What `ledgerline topics` says of it."""
        done = subprocess.run([BIN / "ledgerline", "topics", "--once", "--json", self.status_file], capture_output=True, text=True,
                              timeout=TIMEOUT_S)
        assert done.returncode == 0, done.stderr + self.log()
        return json.loads(done.stdout)

    def topic(self, name: str, direction: str) -> dict | None:
        return next((topic for channel in self.status()["channels"] for topic in channel["topics"]
                     if topic["topic"] == name and topic["direction"] == direction), None)

    def wait_for(self, name: str, direction: str, holds) -> dict:
        """Until `holds` of the topic."""
        deadline = time.monotonic() + TIMEOUT_S
        while not ((topic := self.topic(name, direction)) and holds(topic)):
            assert time.monotonic() < deadline, f"{topic}\n{self.log()}"
            time.sleep(0.05)
        return topic

    def log(self) -> str:
        return self.log_file.read_text()

    def stop(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        assert self.process.wait(timeout=TIMEOUT_S) == 0, self.log()


class Bridge(Program):
    """`ledgerline bridge` of an organisation's User1, in a DDS domain."""

    def __init__(self, ledger, directory: pathlib.Path, organisation: int, domain: int, topics: str, name: str = "bridge",
                 options: str = "", dds: str = "", user: str = "User1"):
        super().__init__(directory, f"{name}{domain}", [BIN / "ledgerline-bridge"],
                         f"status_period_ms = 100\n{tables(ledger, organisation, user)}[dds]\ndomain = {domain}\n{dds}"
                         f'[bridge]\nname = "{name}"\n{options}{topics}')


@pytest.fixture(scope="session", autouse=True)
def lan():
    peers.make_lan()


@pytest.fixture
def running():
    """Ends what a test started."""
    started = []
    yield lambda peer: (started.append(peer), peer)[1]
    for peer in started:
        peer.end()


@pytest.fixture(params=["cyclonedds", "ros2-client"])
def kind(request):
    if missing := peers.why_missing(request.param):
        pytest.skip(missing)
    return request.param


@pytest.fixture
def bridges(tmp_path):
    """Makes bridges, and ends them behind the test."""
    made = []

    def make(*arguments, **named) -> Bridge:
        made.append(Bridge(*arguments, **named))
        return made[-1]
    make.directory = tmp_path
    yield make
    for bridge in made:
        bridge.stop()


@pytest.fixture
def hosts(embedded, tmp_path):
    """Makes an agent of Org1's, enrolled for tello1, or a ground of Org2's, in a DDS domain, and ends them behind the test."""
    roudi = subprocess.Popen([BIN / "ledgerline-roudi"], stdout=subprocess.PIPE, preexec_fn=die_with_parent)
    assert json.loads(roudi.stdout.readline())["ready"]
    made = []

    def make(program: str, organisation: int, domain: int, topics: str, more: str = "", dds: str = "") -> Program:
        config = (f'summary = "{tmp_path / program}.summary.json"\n{tables(embedded, organisation)}[dds]\ndomain = {domain}\n{dds}[[drone]]\nname = "tello1"\n'
                  f"{more}{topics}")
        made.append(Program(tmp_path, program, [BIN / f"ledgerline-{program}", "--config"], config))
        return made[-1]
    yield make
    for program in made:
        program.stop()
    roudi.terminate()
    assert roudi.wait(timeout=TIMEOUT_S) == 0


@pytest.fixture(scope="session", params=["embedded", "fabric"])
def ledger(request, tmp_path_factory):
    directory = tmp_path_factory.mktemp(request.param) / "ledger"
    if request.param == "fabric":
        needs_fabric()
    running = Fabric(directory, "--channel", "teleop", "--channel", "yard") if request.param == "fabric" else Embedded(directory)
    yield running
    assert running.stop() == 0, running.log()


@pytest.fixture(scope="session")
def embedded(tmp_path_factory):
    running = Embedded(tmp_path_factory.mktemp("alone") / "ledger")
    yield running
    assert running.stop() == 0, running.log()
