"""The ground station's API over real sockets, beside a flight: a pilot, onlookers that do not read, outsiders, a flood."""
import json
import math
import os
import pathlib
import random
import signal
import socket
import statistics
import threading
import time

import pytest
from flights import assert_nothing_left, control, fly, no_flight_outlives_its_test, pid_of, printed
from station import Station, is_ready, spoilt, take_off, velocity
from trace_file import TraceKind, records
from websockets.exceptions import ConnectionClosed, InvalidStatus

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
LAND = 3  # FailsafeMode


def end(flight, out: pathlib.Path) -> None:
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(out)
    assert_nothing_left()


def test_a_pilot_flies_by_the_stream_and_falls_silent(tmp_path):
    flight = fly(tmp_path, "--drones", "2", "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    assert oct((tmp_path / "run" / "page.token").stat().st_mode & 0o777) == "0o600"
    assert station.token not in "".join(log.read_text() for log in (tmp_path / "run").glob("*.log"))
    take_off(station, "tello1")
    before = station.drone("tello1")["position"]
    with station.stream() as stream:
        hello = json.loads(stream.recv())
        assert hello["op"] == "hello" and hello["version"] == 1 and hello["manual"], hello
        deadline = time.monotonic() + 30  # not a limit on speed: on a busy host states, and so velocities, may be held back
        while station.drone("tello1")["position"][0] < before[0] + 0.3 and time.monotonic() < deadline:
            stream.send(velocity("tello1", 0.4))
            time.sleep(0.05)
        blocks = []
        while not any(block["kinds"].get("command") and block["ours"] for block in blocks):
            message = json.loads(stream.recv(timeout=60))
            if message["op"] == "blocks":
                assert len(message["blocks"]) <= 50
                blocks += message["blocks"]
    numbers = [block["n"] for block in blocks]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "each once, in order"
    assert all(sum(block["kinds"].values()) == block["txs"] for block in blocks) and any("set" in block["kinds"] for block in blocks), blocks
    after = station.drone("tello1")["position"]
    assert 0.2 < after[0] - before[0] < 1.2, (before, after)
    time.sleep(2)  # the stream is closed: nobody steers
    still = station.wait("tello1", lambda drone: math.hypot(*drone["velocity"]) < 0.15)
    assert still["phase"] == "manual" and math.dist(still["position"], after) < 1, (after, still)
    assert station.drone("tello2")["phase"] == "waiting", "a word to one drone moves no other"
    station.say("drones/tello1/land")
    station.wait("tello1", lambda drone: drone["phase"] == "landed")
    end(flight, tmp_path)


def test_stop_all_lands_every_drone_and_says_who_stopped_it(tmp_path):
    flight = fly(tmp_path, "--drones", "2", "--shape", "square", "--laps", "50", "--watch")
    station = Station(tmp_path, flight)
    for name in ("tello1", "tello2"):
        station.wait(name, lambda drone: drone["phase"] == "path" and station.path(name) and drone["predicted"])
    with station.stream() as stream:
        station.say("stop", {})
        events = []
        while sum("landed" in event["text"] for event in events) < 2:
            message = json.loads(stream.recv(timeout=60))
            if message["op"] == "events":
                events += message["events"]
    numbers = [event["n"] for event in events]
    assert numbers == list(range(1, len(numbers) + 1)), "each once, in order"
    for name in ("tello1", "tello2"):
        stopped = [event for event in events if event["drone"] == name and event["text"].startswith("stopped by Org2MSP")]
        assert stopped and stopped[0]["level"] == "alarm", events
    assert flight.wait(60) == 1, printed(tmp_path)
    assert_nothing_left()


def resident_kb(pid: int) -> int:
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))


def test_onlookers_that_do_not_read_cost_the_others_nothing(tmp_path):
    flight = fly(tmp_path, "--drones", "3", "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    take_off(station, "tello1")
    deaf = [station.stream(max_queue=1) for _ in range(7)]  # and one that reads: eight of an address
    with station.stream() as stream:
        begin, memory = time.monotonic(), resident_kb(pid_of("ledgerline-ground"))
        ages, moments = [], []
        while time.monotonic() < begin + 8:
            message = json.loads(stream.recv(timeout=60))
            if message["op"] == "state":
                moments.append(message["t_ms"])
                ages.append(message["drones"][0]["state_age_ms"])
    rate = 1e3 * (len(moments) - 1) / (moments[-1] - moments[0])
    print(f"{rate:.1f} states a second beside seven that do not read, age of a state p50 {statistics.median(ages):.1f} ms")
    assert rate > 15 and moments == sorted(moments)
    assert resident_kb(pid_of("ledgerline-ground")) < memory + 20_000
    for one in deaf:
        one.close_socket()
    station.say("stop")
    station.wait("tello1", lambda drone: drone["stopped_by"] and drone["phase"] == "landed")
    end(flight, tmp_path)


def test_outsiders_are_refused_and_hostile_bytes_move_nothing(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    station.wait("tello1", lambda drone: drone["link_phase"] == "on_ground")
    takeoff = "drones/tello1/takeoff"
    assert station.ask("POST", takeoff, headers={"Authorization": "Bearer " + "0" * 64})[0] == 401
    assert station.ask("POST", takeoff, headers={"Origin": "http://evil.example"})[0] == 403
    assert station.ask("POST", takeoff, headers={"Host": "evil.example"})[0] == 403
    assert station.ask("POST", takeoff, body={"cut": True})[0] == 400
    for refused in ({"origin": "http://evil.example"}, {"subprotocols": ["ledgerline.v1"]}):
        with pytest.raises(InvalidStatus):
            station.stream(**refused)
    with station.stream() as stream:
        stream.send('{"op":"takeoff","drone":"tello1"}')
        with pytest.raises(ConnectionClosed):
            while True:
                stream.recv(timeout=60)
    draw = random.Random(1)
    heads = [f"POST /api/v1/{takeoff} HTTP/1.1\r\nHost: {station.place}\r\nAuthorization: Bearer {station.token}\r\nContent-Length: 2\r\n\r\n[]",
             f"GET /api/v1/stream HTTP/1.1\r\nHost: {station.place}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
             f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: ledgerline.v1\r\n\r\n"]
    address, port = station.place.split(":")
    for _ in range(10_000 if LONG else 500):
        with socket.create_connection((address, int(port)), timeout=30) as wire:
            wire.sendall(spoilt(draw, draw.choice(heads).encode()))
            wire.shutdown(socket.SHUT_WR)
            while wire.recv(4096):
                pass
    assert station.drone("tello1")["phase"] == "waiting"
    end(flight, tmp_path)


def test_a_stop_lands_beside_a_flood_of_requests(tmp_path):
    rounds = 30 if LONG else 1
    flight = fly(tmp_path, "--drones", "4", "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    run = tmp_path / "run"
    names = [f"tello{k}" for k in range(1, 5)]
    over = threading.Event()

    def flood() -> None:
        while not over.is_set():
            station.ask("GET", "events")

    crowd = [threading.Thread(target=flood) for _ in range(4)]
    for one in crowd:
        one.start()
    clicked = []
    for _ in range(rounds):
        for name in names:
            station.wait(name, is_ready)
            station.say(f"drones/{name}/takeoff")
        for name in names:
            station.wait(name, lambda drone: drone["phase"] == "manual")
        for k, name in enumerate(names, 1):
            time.sleep(0.5)
            clicked.append((k, time.monotonic_ns()))
            station.say(f"drones/{name}/stop")
        for name in names:
            station.wait(name, lambda drone: drone["stopped_by"] and drone["phase"] == "landed")
        control(run / "operator.toml", "clear_stop", *names)
    over.set()
    for one in crowd:
        one.join()
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()
    landing = [r for r in records(run / "link.trace") if r.kind == TraceKind.MODE and r.extra == LAND]
    took = []
    for k, at_ns in clicked:
        after = [r.t_ns for r in landing if r.drone == k and r.t_ns > at_ns]
        assert after, f"tello{k} was not landed by its stop"
        took.append((after[0] - at_ns) / 1e6)
    took.sort()
    two_way = sorted((r.t_ns - r.stamp_ns) / 1e6 for r in records(run / "agent.trace") if r.kind == TraceKind.COMMAND_VERIFIED)
    print(f"from click to landing, {len(took)} stops: p50 {statistics.median(took):.1f}, p99 {took[int(0.99 * (len(took) - 1))]:.1f}, "
          f"most {took[-1]:.1f} ms; two-way p50 {statistics.median(two_way):.1f}, p99 {two_way[int(0.99 * (len(two_way) - 1))]:.1f} ms")
