"""A channel of the version before, with drones in the air, leases and stops, goes to today's contract as the next sequence."""
import base64
import collections
import hashlib
import json
import pathlib
import re
import subprocess
import threading
import time

from before import ANY_PEER, Before, write_script
from conftest import Members
from fabric import FABRIC, Network, needs_fabric
from flights import (BIN, assert_nothing_left, fly, holds, no_flight_outlives_its_test, printed, result, without_commands)
from official import ENDORSEMENT_POLICY_FAILURE, MVCC_READ_CONFLICT, VALID, encode
from programs import ask, user_msp
from trace_file import TraceKind, records

LAPS = 4  # the move, and what is looked at behind it, take less
TIMEOUT_S = 120  # not a limit on speed: only how long a broken test may take
FLOWN, GROUNDED, CLEARED, STOPPED_LATER, STOPPED_MEANWHILE = ("tello1", "tello2"), "tello3", "tello1", "tello4", "tello5"


def subject(organisation: int, user: str) -> str:
    return f"CN={user}@org{organisation}.ledgerline,OU={'admin' if user == 'Admin' else 'client'},O=org{organisation}.ledgerline"


def digest(organisation: int, user: str) -> str:
    return hashlib.sha256(f"Org{organisation}MSP\n{subject(organisation, user)}".encode()).hexdigest()


def programs_of_before(home: pathlib.Path, before: Before) -> pathlib.Path:
    """A folder of programs to fly with, whose network is one of before, and whose pilot stops a drone and clears that stop before take-off."""
    programs = home / "programs"
    programs.mkdir()
    for program in BIN.glob("ledgerline-*"):
        (programs / program.name).symlink_to(program)
    ledgerline = BIN / "ledgerline"
    others = "".join(f" --drone {drone}" for drone in (GROUNDED, STOPPED_LATER, STOPPED_MEANWHILE))
    write_script(programs / "ledgerline", f'[ "$1" != fabric ] || exec {before.fabric} "$@" --tools {before.tools} --signature-policy "{ANY_PEER}"{others}\n'
                                          f'{ledgerline} "$@" || exit\n[ "$1 $4" != "control acquire" ] || '
                                          f'{{ {ledgerline} control "$2" "$3" stop {CLEARED} && {ledgerline} control "$2" "$3" clear_stop {CLEARED}; }}')
    return programs


def upgrade(program: pathlib.Path, ledger: pathlib.Path) -> subprocess.CompletedProcess:
    return subprocess.run([program, "fabric", "upgrade", "--dir", ledger, "--tools", FABRIC], capture_output=True, text=True, timeout=TIMEOUT_S)


class Stops(threading.Thread):
    """Stops a drone again and again, as a pilot does by hand, inside a with; how long each took [s]."""

    def __init__(self, config: pathlib.Path):
        super().__init__()
        self.config, self.ending, self.took, self.refused = config, threading.Event(), [], []

    def __enter__(self) -> "Stops":
        self.start()
        return self

    def __exit__(self, *_) -> None:
        self.ending.set()
        self.join()

    def run(self) -> None:
        while not self.ending.is_set():
            begun = time.monotonic()
            said = subprocess.run([BIN / "ledgerline", "control", "--config", self.config, "stop", STOPPED_MEANWHILE], capture_output=True,
                                  text=True, timeout=TIMEOUT_S)
            self.took.append(time.monotonic() - begun)
            if said.returncode != 0:
                self.refused.append(said.stderr)


def wait_for_paths(out: pathlib.Path, flight: subprocess.Popen) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not all(re.search(rf"{drone}\b.*?\bpath [1-9]\d %", printed(out)) for drone in FLOWN):
        assert flight.poll() is None and time.monotonic() < deadline, printed(out)
        time.sleep(0.1)


def record(client, key: str) -> bytes:
    return base64.b64decode(client.read("get", key).get("msgData", ""))


def plan(drone: str) -> dict:
    return {"organisation": "Org1MSP", "plans": [{"drone": drone, "epoch": "1", "setpoints": [{"atNs": "1000", "vx": 0.5}]}]}


def submit_over_others(client, fn: str, *args) -> None:
    """The agent's apply_stops writes the same lease, and what read it before that is invalid."""
    for _ in range(10):
        answer = client.call("submit", fn, *args)
        if answer.get("successful"):
            return
        assert answer.get("code") in (ENDORSEMENT_POLICY_FAILURE, MVCC_READ_CONFLICT), answer
    raise AssertionError(answer)


def kept_by_org1() -> list[str]:
    host, pilot = digest(1, "User1"), digest(2, "User1")
    return [f"{kind}/{drone}" for kind in ("control", "owner", "grant", "request") for drone in FLOWN] + [
        f"role/Org1MSP/{digest(1, 'User2')[0]}", f"host/{host}", f"frame/{host}", f"lease/Org1MSP/{pilot}/1", f"pilot/Org1MSP/{pilot}", f"command/Org1MSP/{pilot}"]


def chain(members: Members, blocks: int) -> list[list[int]]:
    """The flags of each block's transactions from the first block on, as our own reader has them."""
    directory = members.ledger.directory
    done = ask(members.ledger.endpoint, directory, 1, user_msp(directory, 1, "User1"), "blocks", "0", str(blocks))
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("block ")]
    assert [int(line.split()[1].rstrip(",")) for line in lines] == list(range(blocks))
    return [[int(flag) for flag in re.findall(r"=(\d+)", line)] for line in lines]


def test_a_living_channel_moves_and_its_drones_fly_on(tmp_path, monkeypatch, members):
    needs_fabric()
    before = Before(tmp_path)
    monkeypatch.setenv("LEDGERLINE_BIN", str(programs_of_before(tmp_path, before)))
    flight = fly(tmp_path, "--ledger", "fabric", "--drones", "2", "--laps", str(LAPS), "--speed", "0.5")
    wait_for_paths(tmp_path, flight)
    ledger = tmp_path / "run" / "ledger"
    who = members(ledger)
    host, pilot, guard, admin = who(1, "User1"), who(2, "User1"), who(1, "User2"), who(1, "Admin")

    # Before: a drone on the ground that its pilot holds and a guard has stopped; and anybody's peer writes what it wants.
    admin.submit("enroll", {"identity": {"mspId": "Org1MSP", "subject": subject(1, "User2")}, "role": "OPERATOR"})
    pilot.submit("acquire", {"drones": [GROUNDED, STOPPED_LATER]})
    guard.submit("stop", GROUNDED)
    host.submit("apply_stops", {"drones": [GROUNDED]})
    stopped = f"{GROUNDED}: stopped by Org1MSP {subject(1, 'User2')}; only LAND is accepted until they, or a supervisor of Org1MSP, clear it"
    assert pilot.refusal("command", plan(GROUNDED)) == stopped
    lease_before = f"lease/{digest(2, 'User1')}/1"
    drones = (*FLOWN, GROUNDED, STOPPED_LATER)
    assert all(drone.encode() in record(pilot, lease_before) for drone in drones)
    assert "not found" in pilot.refusal("get", f"pilot/Org1MSP/{digest(2, 'User1')}")
    assert who.forge([{"key": "free/before", "value": encode("x")}], 3) == VALID
    controls = {drone: record(pilot, f"control/{drone}") for drone in drones}
    cleared = record(pilot, f"stop/{CLEARED}/{digest(2, 'User1')}")

    refused = upgrade(BIN / "ledgerline", ledger)
    assert refused.returncode == 1 and "put this version's programs in the place of those" in refused.stderr
    before.update(ledger)
    with Stops(tmp_path / "run" / "operator.toml") as stops:
        begun_ns = time.monotonic_ns()
        done = upgrade(before.fabric, ledger)
        ended_ns = time.monotonic_ns()
    assert done.returncode == 0, done.stdout + done.stderr
    assert stops.refused == [] and len(stops.took) > 1

    guard.submit("stop", STOPPED_LATER)
    assert "stopped by" in pilot.refusal("command", plan(STOPPED_LATER)), "nobody has renewed it"
    # Who flew goes on under its lease, renewed by its agent.
    deadline = time.monotonic() + 30
    while errors := [error for drone in FLOWN if (error := pilot.call("evaluate", "command", plan(drone)).get("error"))]:
        assert time.monotonic() < deadline and flight.poll() is None, errors
    # What nobody flies is renewed by the next control call: its stopper's word, or its host's.
    submit_over_others(guard, "clear_stop", STOPPED_LATER)
    submit_over_others(pilot, "command", plan(STOPPED_LATER))
    assert pilot.refusal("command", plan(GROUNDED)) == stopped
    submit_over_others(host, "apply_stops", {"drones": [GROUNDED]})
    assert pilot.refusal("command", plan(GROUNDED)) == stopped
    after = {drone: record(pilot, f"control/{drone}") for drone in drones}
    assert after.pop(STOPPED_LATER).startswith(controls.pop(STOPPED_LATER)), "behind that how often its stop was cleared"
    assert after == controls, "holders, epochs, stops, grants"
    lease = record(pilot, f"lease/Org1MSP/{digest(2, 'User1')}/1")
    assert all(drone.encode() in lease for drone in drones)
    # Roles count as they are until their organisation writes one: then all of them have moved, with its policy.
    assert "not found" in pilot.refusal("get", f"role/Org1MSP/{digest(1, 'User2')[0]}")
    admin.submit("enroll", {"identity": {"mspId": "Org1MSP", "subject": subject(1, "User2")}, "role": "OPERATOR"})
    assert subject(1, "User2").encode() in record(pilot, f"role/Org1MSP/{digest(1, 'User2')[0]}")
    guard.submit("stop", STOPPED_MEANWHILE)
    moved = who.height()
    # Whose peer may write what, from now on.
    for key in kept_by_org1():
        for organisations in ((3,), (2, 3)):
            assert who.forge([{"key": key, "value": encode("forged")}], *organisations) == ENDORSEMENT_POLICY_FAILURE, key
    assert who.forge([{"key": "free/after", "value": encode("x")}], 3) == ENDORSEMENT_POLICY_FAILURE
    # What was written before reads as before.
    assert all(drone.encode() in record(pilot, lease_before) for drone in drones)
    assert record(pilot, f"stop/{CLEARED}/{digest(2, 'User1')}") == cleared
    assert len(pilot.read("history", f"control/{FLOWN[0]}")["versions"]) >= 3
    assert pilot.read("history", f"{FLOWN[0]}/odom")["versions"]
    height = who.height()
    flags = chain(who, height)

    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    report = result(tmp_path)
    assert report["ok"] and all(len(drone["lap_s"]) == LAPS for drone in report["drones"])
    trace = records(tmp_path / "run" / "link.trace")
    agent = json.loads((tmp_path / "run" / "agent.summary.json").read_text())
    ground = json.loads((tmp_path / "run" / "ground.summary.json").read_text())
    print(f"upgrade: {(ended_ns - begun_ns) / 1e9:.1f} s; flags of {moved} blocks: "
          f"{dict(collections.Counter(flag for block in flags[:moved] for flag in block))}")
    print(f"{len(stops.took)} stops meanwhile: on the ledger after {min(stops.took):.2f} to {max(stops.took):.2f} s")
    print(f"agent: {agent['transactions']}, stops applied {agent['stops_applied']}; ground: {ground['transactions']}")
    for number, drone in enumerate(report["drones"], 1):
        own = [r for r in trace if r[2] == number]
        held = holds(own, begun_ns)
        print(f"tello{number}: {without_commands(own, begun_ns):.2f} s without a command; held "
              f"{', '.join(f'{begin:.2f} s after the beginning for {lasted:.2f} s' for begin, lasted in held) or 'never'}; "
              f"{drone['cross_track_m']['max']:.2f} m off the path at most", flush=True)
    truth = [r for r in records(tmp_path / "run" / "sim.trace") if r[1] == TraceKind.TRUTH and begun_ns < r[0] < ended_ns]
    assert len(truth) > 10 and all(r[3] == 1 for r in truth), "it came down"
    assert_nothing_left()

    # The network starts again as what it is now, by itself.
    again = Network(ledger).wait_ready()
    after = members(ledger)
    assert after(2, "User1").refusal("command", plan(GROUNDED)) == stopped
    assert chain(after, height) == flags
    again.stop()
