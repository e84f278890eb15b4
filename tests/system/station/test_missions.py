"""Missions at the station: written, checked, approved on the ledger, flown together, paused; and a ground that is killed."""
import json
import math
import os
import random
import signal
import subprocess
import time

import pytest
from flights import BIN, control, fly, no_flight_outlives_its_test, pid_of, printed
from station import Station
from test_operators import holder, sign_in
from test_station import end

LONG = os.environ.get("LEDGERLINE_LONG") == "1"


def mission(station: Station, name: str, ways: dict, then: str = "hover") -> dict:
    """Of waypoints from where each drone stands now."""
    drones = []
    for drone, way in ways.items():
        known = station.wait(drone, lambda d: d["link_phase"] in ("on_ground", "landed", "flying") and d["position"]
                             and d["battery_percent"] is not None)  # a message of its own, which may come after the pose
        x, y, _ = known["position"]
        drones.append({"drone": drone, "then": then,
                       "waypoints": [{"x": round(x + dx, 3), "y": round(y + dy, 3), "z": 1.2} for dx, dy in way]})
    return {"name": name, "drones": drones}


def phase_of(station: Station, one: str) -> dict:
    return station.ask("GET", f"missions/{one}")[1]


def until(station: Station, one: str, wanted, limit_s: float = 90) -> dict:
    deadline = time.monotonic() + limit_s
    while not wanted(reported := phase_of(station, one)):
        assert time.monotonic() < deadline, reported
        time.sleep(0.1)
    return reported


def add(station: Station, written: dict) -> str:
    status, answer = station.ask("POST", "missions", written)
    assert status == 201, answer
    return answer["id"]


def test_a_mission_is_checked_approved_flown_together_and_on_the_ledger(tmp_path):
    flight = fly(tmp_path, "--drones", "2", "--shape", "manual", "--watch", "--operators", "alice,bob")
    station = Station(tmp_path, flight)
    alice = sign_in(station, tmp_path, "alice")
    crossing = mission(station, "crossing", {"tello1": [(1, 1)], "tello2": [(-1, 1)]})
    crossing["drones"][1]["waypoints"] = crossing["drones"][0]["waypoints"]
    found = phase_of(alice, add(alice, crossing))["findings"]
    assert any(one["forbids"] for one in found), found
    written = mission(station, "survey", {"tello1": [(1, 0), (1, 1), (0, 1)], "tello2": [(1, 0), (1, 1), (0, 1)]}, "land")
    assert station.ask("POST", "missions", written)[0] == 403, "nobody is signed in"
    one = add(alice, written)
    assert phase_of(alice, one)["findings"] == [], phase_of(alice, one)
    status, refused = alice.ask("POST", f"missions/{one}/start")
    assert status == 409, refused
    for name in ("tello1", "tello2"):
        alice.say(f"drones/{name}/acquire")
        station.wait(name, holder("alice"))
    status, refused = alice.ask("POST", f"missions/{one}/start")
    assert status == 409 and "0 of 1 approvals" in refused["error"], refused
    alice.say(f"missions/{one}/approve")
    approved = until(alice, one, lambda reported: reported["phase"] == "approved")
    assert approved["approvals"] == [alice.identity]
    alice.say(f"missions/{one}/start")
    flying = until(alice, one, lambda reported: reported["phase"] in ("to_start", "flying"))
    assert flying["by"] == alice.identity
    assert alice.ask("DELETE", f"missions/{one}")[0] == 409, "while it is flown"
    until(alice, one, lambda reported: all(n >= 1 for n in reported["reached"].values()))
    alice.say(f"missions/{one}/pause")
    for name in ("tello1", "tello2"):
        station.wait(name, lambda drone: drone["paused"] and math.hypot(*drone["velocity"]) < 0.1)
    alice.say(f"missions/{one}/resume")
    until(alice, one, lambda reported: reported["phase"] == "done")
    for name in ("tello1", "tello2"):
        station.wait(name, lambda drone: drone["phase"] == "landed")
    record = tmp_path / "run" / "missions" / f"{one}.record.json"
    deadline = time.monotonic() + 20
    while (verified := subprocess.run([BIN / "ledgerline", "control", "--config", tmp_path / "run" / "operator.toml", "verify", record],
                                      capture_output=True, text=True, timeout=30)).returncode != 0:
        assert time.monotonic() < deadline, verified.stderr
        time.sleep(0.5)
    assert "what became of mission survey" in verified.stdout
    assert json.loads(record.read_text())["phase"] == "done"
    for kept in (record, record.with_name(f"{one}.json")):
        digest = subprocess.run([BIN / "ledgerline", "missions", "digest", kept, "--json"], capture_output=True, text=True, timeout=30)
        assert digest.returncode == 0 and json.loads(digest.stdout)["digest"].startswith(one), digest.stdout + digest.stderr
    end(flight, tmp_path)


def test_two_persons_are_two_when_the_mission_starts(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch", "--operators", "alice,bob", "--approvals", "2")
    station = Station(tmp_path, flight)
    alice, bob = sign_in(station, tmp_path, "alice"), sign_in(station, tmp_path, "bob")
    one = add(alice, mission(station, "survey", {"tello1": [(1, 0), (1, 1)]}, "land"))
    alice.say("drones/tello1/acquire")
    station.wait("tello1", holder("alice"))
    for who in (alice, bob):
        who.say(f"missions/{one}/approve")
    until(alice, one, lambda reported: len(reported["approvals"]) == 2)
    for method, path in (("POST", "start"), ("POST", "pause"), ("POST", "resume"), ("DELETE", "")):
        status, refused = bob.ask(method, f"missions/{one}/{path}".rstrip("/"))
        assert status == 409 and "alice" in refused["error"] and "who alone may" in refused["error"], (path, refused)
    run = tmp_path / "run"
    control(run / "operators-admin.toml", "revoke", "--msp", "Org2MSP", "--cert", run / "operators/bob/signcerts/bob-cert.pem")
    status, refused = alice.ask("POST", f"missions/{one}/start")
    assert status == 409 and "1 of 2 approvals" in refused["error"], refused
    bob_is_out = time.monotonic() + 60
    while bob.ask("GET", "drones")[0] != 401:
        assert time.monotonic() < bob_is_out, "his session goes on"
        time.sleep(0.1)
    with pytest.raises(AssertionError, match="as none any more"):
        sign_in(station, tmp_path, "bob")
    until(alice, one, lambda reported: reported["approvals"] == [alice.identity])
    end(flight, tmp_path)


def comes_back(station: Station, pid: int) -> None:
    deadline = time.monotonic() + 60
    while True:
        try:
            if pid_of("ledgerline-ground") != pid and station.ask("GET", "missions")[0] == 200:
                return
        except (OSError, StopIteration, ValueError, AssertionError):
            pass
        assert time.monotonic() < deadline, "no ground came back"
        time.sleep(0.1)


def killed_in_a_mission(out, draw: random.Random, kills: int) -> int:
    """A flight whose ground is killed so often, or until its battery has done enough. How often it was."""
    flight = fly(out, "--drones", "2", "--shape", "manual", "--watch")
    station = Station(out, flight)
    way = [(1.5, 0), (1.5, 1.5), (0, 1.5), (0, 0)] * 30
    one = add(station, mission(station, "rounds", {"tello1": way, "tello2": way}))
    station.say(f"missions/{one}/approve")
    until(station, one, lambda reported: reported["phase"] == "approved")
    station.say(f"missions/{one}/start")
    flown = dict(until(station, one, lambda reported: reported["phase"] == "flying")["reached"])
    killed = 0
    while killed < kills and max(flown.values()) <= 100:
        time.sleep(draw.uniform(0.5, 4))
        pid = pid_of("ledgerline-ground")
        os.kill(pid, signal.SIGKILL)
        killed += 1
        comes_back(station, pid)
        for name in flown:  # what was kept says nothing of now
            station.wait(name, lambda drone: drone["link_phase"] == "flying" and drone["lease"]["ours"] and drone["phase"] == "path")
        flown = dict(phase_of(station, one)["reached"])
        reported = until(station, one, lambda reported: all(reported["reached"][name] > flown[name] for name in flown))
        assert reported["phase"] in ("to_start", "flying") and not reported["paused"], reported
        flown = dict(reported["reached"])
    station.say(f"missions/{one}/land")
    for name in flown:
        station.wait(name, lambda drone: drone["phase"] == "landed")
    end(flight, out)
    return killed


def test_a_ground_that_is_killed_goes_on_with_its_mission(tmp_path):
    kills = 200 if LONG else 3
    draw = random.Random(7)
    flights = []
    while (left := kills - sum(flights)) > 0:
        flights.append(killed_in_a_mission(tmp_path / f"flight{len(flights)}", draw, left))
    print(f"{kills} kills in the middle of {len(flights)} missions: each went on")
