"""Faults that people switch at the station: a drone falls silent, its failsafe is named, and it flies on."""
import json
import os
import signal
import stat
import time

from flights import assert_nothing_left, fly, no_flight_outlives_its_test, pid_of, printed
from station import Station, take_off, velocity
from test_missions import comes_back


def faults(station: Station) -> dict[str, bool]:
    status, answer = station.ask("GET", "faults")
    assert status == 200, answer
    return {fault["name"]: fault["on"] for fault in answer["faults"]}


def switch(station: Station, name: str, on: bool) -> None:
    status, answer = station.ask("POST", "faults", {"name": name, "on": on})
    assert status == 200 and {fault["name"]: fault["on"] for fault in answer["faults"]}[name] is on, answer


def test_a_silent_drone_is_braked_by_name_and_flies_on(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch", "--fault-switches")
    station = Station(tmp_path, flight)
    socket = tmp_path / "run" / "switches.sock"
    assert stat.S_IMODE(socket.stat().st_mode) == 0o600
    take_off(station, "tello1")
    assert set(faults(station)) == {"ledger-delayed", "ledger-stalled", "silent-tello1", "commands-lost-tello1"}
    assert not any(faults(station).values())
    assert station.ask("POST", "faults", {"name": "silent-tello9", "on": True})[0] == 404
    assert station.ask("POST", "faults", {"name": "silent-tello1", "on": True}, {"Authorization": ""})[0] == 401
    assert station.ask("POST", "faults", {"name": "silent-tello1", "on": True}, {"Origin": "http://elsewhere.example"})[0] == 403
    assert not any(faults(station).values())

    switch(station, "silent-tello1", True)
    braked = station.wait("tello1", lambda drone: drone["mode"] == "brake")
    switch(station, "silent-tello1", False)
    assert braked["cause"] == "state_stale" and braked["phase"] == "manual", braked
    station.wait("tello1", lambda drone: drone["mode"] == "none" and drone["phase"] == "manual")
    before = station.drone("tello1")["position"]
    with station.stream() as stream:
        deadline = time.monotonic() + 30
        while station.drone("tello1")["position"][0] < before[0] + 0.3:
            assert time.monotonic() < deadline, "it does not fly on"
            stream.send(velocity("tello1", 0.4))
            time.sleep(0.05)
    events = station.ask("GET", "events")[1]["events"]
    said = [(event["level"], event["text"]) for event in events if event["drone"] == "tello1" and "switched" in event["text"]]
    assert said == [("warning", "Drone silent: switched on"), ("info", "Drone silent: switched off")], events

    # All go off with ground, which comes back: nobody could switch them meanwhile.
    switch(station, "ledger-delayed", True)
    pid = pid_of("ledgerline-ground")
    os.kill(pid, signal.SIGKILL)
    comes_back(station, pid)
    deadline = time.monotonic() + 30
    while station.ask("GET", "faults")[0] != 200 or any(faults(station).values()):
        assert time.monotonic() < deadline, faults(station)
        time.sleep(0.1)

    # And with the flight: a deaf drone could not be commanded to land.
    switch(station, "commands-lost-tello1", True)
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()
    switched = [each["command"] for each in json.loads((tmp_path / "run" / "hil-proxy.summary.json").read_text())["switched"]]
    assert switched == ["drone tello1 from partition", "drone tello1 from partition off",
                        "server agent* both delay 100ms", "server agent* both delay off", "drone tello1 to partition",
                        "drone tello1 to partition off"], switched
