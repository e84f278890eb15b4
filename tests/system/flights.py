"""One flight of ledgerline fly, as a person starts it, watched from outside."""
import contextlib
import json
import os
import pathlib
import re
import signal
import subprocess
import time

import pytest
from fabric import FABRIC
from trace_file import TraceKind

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
FLYING = 3  # LinkPhase
NONE, HOLD = 0, 1  # FailsafeMode


started = []


@pytest.fixture(autouse=True)
def no_flight_outlives_its_test():
    """One that failed must not fail those after it: there is one flight at a time."""
    yield
    for flight in started:
        for _ in range(2):  # the second one: without waiting for the drones
            if flight.poll() is None:
                flight.send_signal(signal.SIGINT)
                time.sleep(0.5)
        flight.wait(60)
    started.clear()


def fly(out: pathlib.Path, *options: str) -> subprocess.Popen:
    out.mkdir(exist_ok=True)
    log = open(out / "fly.out", "wb")
    started.append(subprocess.Popen([BIN / "ledgerline", "fly", "--out", out / "run", "--json", out / "result.json", *options],
                                    stdout=log, stderr=subprocess.STDOUT))
    return started[-1]


def printed(out: pathlib.Path) -> str:
    return (out / "fly.out").read_text(errors="replace")


def result(out: pathlib.Path) -> dict:
    return json.loads((out / "result.json").read_text())


def as_user(run: pathlib.Path, organisation: int, user: str) -> pathlib.Path:
    """The config of ledgerline control of another user than the flight's operator."""
    text = (run / "operator.toml").read_text().replace("Org2MSP", f"Org{organisation}MSP")
    config = run / f"org{organisation}-{user}.toml"
    config.write_text(re.sub(r'msp_dir = ".*"', f'msp_dir = "{user_dir(run, organisation, user)}"', text))
    return config


def user_dir(run: pathlib.Path, organisation: int, user: str) -> pathlib.Path:
    name = f"org{organisation}.ledgerline"
    return run / "ledger" / "crypto" / "peerOrganizations" / name / "users" / f"{user}@{name}" / "msp"


def enroll_operator(run: pathlib.Path, organisation: int, user: str) -> pathlib.Path:
    """By the administrator of its organisation; its config."""
    control(as_user(run, organisation, "Admin"), "enroll", "--msp", f"Org{organisation}MSP", "--role", "operator", "--cert",
            next((user_dir(run, organisation, user) / "signcerts").iterdir()))
    return as_user(run, organisation, user)


def control(config: pathlib.Path, *words) -> None:
    subprocess.run([BIN / "ledgerline", "control", "--config", config, *words], check=True, timeout=30, stdout=subprocess.DEVNULL)


def our_processes() -> dict[int, str]:
    """Programs of this build, and Fabric's, in this network namespace."""
    here = os.readlink("/proc/self/ns/net")
    found = {}
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            exe = pathlib.Path(os.readlink(process / "exe"))
            if exe.parent in (BIN, FABRIC) and os.readlink(process / "ns/net") == here:
                found[int(process.name)] = exe.name
        except OSError:
            pass  # it ended meanwhile
    return found


def pid_of(program: str) -> int:
    return next(pid for pid, name in our_processes().items() if name == program)


def wait_for_flight(out: pathlib.Path, flight: subprocess.Popen) -> None:
    """Until the first drone flies, as the ground says."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        assert flight.poll() is None, printed(out)
        if re.search(r"tello1\b.*\bpath\b", printed(out)):
            return
        time.sleep(0.1)
    pytest.fail("not in the air after a minute:\n" + printed(out))


def assert_nothing_left() -> None:
    deadline = time.monotonic() + 5
    while our_processes() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert our_processes() == {}
    assert [f for f in os.listdir("/dev/shm")] == []


def without_commands(trace: list[tuple], since_ns: int = 0) -> float:
    """The maximum time in which link flew no new command, between the first lap's beginning and the end."""
    times = [r[0] for r in trace if r[1] == TraceKind.COMMAND_APPLIED]
    times = [t for t in times if t - times[0] > 5e9]  # the first one asks for the take-off
    return max(b - a for a, b in zip(times, times[1:]) if b > since_ns) / 1e9


def holds(trace: list[tuple], since_ns: int) -> list[tuple[float, float]]:
    """When each hold in the air began after `since_ns`, and how long it lasted [s]; nothing but holds may be there."""
    modes = [(r[0], r[3]) for r in trace if r[1] == TraceKind.MODE and r[4] == FLYING and r[0] > since_ns]
    assert {m for _, m in modes} <= {NONE, HOLD}, modes
    assert not modes or modes[-1][1] == NONE, modes
    changes = [m for before, m in zip([(0, NONE), *modes], modes) if before[1] != m[1]]  # a hold may change its cause
    return [((begin - since_ns) / 1e9, (end - begin) / 1e9)
            for (begin, mode), (end, _) in zip(changes, changes[1:]) if mode == HOLD]


SAFE = """
[fence]
min_m = [-3, -3, 0]
max_m = [3, 3, 2]
"""
POSES = """
[pose]
source = "mocap"
topic = "/vrpn_mocap/{drone}/pose"
"""


def deployment(directory: pathlib.Path, text: str, drones: int = 1) -> pathlib.Path:
    file = directory / "real.toml"
    for k in range(drones):
        text += f'\n[[drone]]\nname = "tello{k + 1}"\naddress = "127.0.0.{k + 2}"\n'
    file.write_text(text)
    return file


@contextlib.contextmanager
def somebody_elses(*command):
    """A program that fly does not start, and must not end; its ready line and the process are yielded."""
    program = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        yield json.loads(program.stdout.readline()), program
        assert program.poll() is None, "fly ended what it did not start"
    finally:
        program.terminate()
        assert program.wait(10) == 0
        program.stdout.close()


@contextlib.contextmanager
def somebody_elses_drones(directory: pathlib.Path, drones: int = 1, *more: str):
    """Drones and motion capture that fly did not start and does not end."""
    config = directory / "sim.toml"
    config.write_text("[dds]\nlocal_only = true\n")
    with somebody_elses(BIN / "ledgerline-sim", "--config", config, "--drones", str(drones), "--summary",
                        directory / "sim.json", *more) as (line, sim):
        assert line["ready"] is True
        yield sim
