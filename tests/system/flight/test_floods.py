"""A stop beside each flood, of the embedded ledger or of ground's page, while four drones fly: how long it takes,
whichever way it is said, and whether a drone ever held. The figures are held against the quiet time of the same flight,
since the machine's own speed is nobody's."""
import http.client
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from flights import (BIN, FLYING, NONE, as_user, assert_nothing_left, control, enroll_operator, fly, no_flight_outlives_its_test,
                     printed, user_dir)
from page_flood import AWAY_S
from station import Station, take_off
from test_operators import Signed, holder, sign_in
from test_tls import SecureStation, restart, make
from trace_file import TraceKind, records
from websockets.sync.client import ClientConnection

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
FLYERS = [f"tello{k}" for k in range(1, 5)]
# What is stopped, and does not fly: one of the page's, and one that is only enrolled.
OF_THE_PAGE, OF_THE_LEDGER = "tello5", "tello9"
SECONDS = 40       # of each flood, and of the quiet time before it: more than a hundred stops each way
MARGIN_MS = 100    # that a stop may take beyond the quiet two-way's p99


def of_ledger(*words):
    return lambda run, station: [BIN / "test_flood", "--config", as_user(run, 3, "User2"), *words]


def of_page(what: str):
    program = pathlib.Path(__file__).with_name("page_flood.py")
    return lambda run, station: [sys.executable, program, what, "--url", station.url, "--token", station.token]


FLOODS = {"urgent": of_ledger("urgent"), "more_than_it_can": of_ledger("urgent", "--per-second", "2000"),
          "askers": of_ledger("askers"), "streams": of_page("streams"), "connections": of_page("connections"),
          "connections_tls": of_page("connections"), "bodies": of_page("bodies")}
# More requests than two cores answer: it flies to its end, each stop is on the ledger, and how soon is the machine's.
BEYOND_THE_BAR = {"more_than_it_can"}
# That was sent, so that it was a flood.
LEAST = {"streams": 70, "connections": 900 * SECONDS, "connections_tls": 900 * SECONDS}


def figures(values: list[float]) -> dict:
    ordered = sorted(values)
    at = lambda share: round(ordered[min(len(ordered) - 1, int(share * len(ordered)))], 1)
    return {"p50": at(0.5), "p99": at(0.99), "count": len(ordered)}


class Page:
    """An open page, at which nobody has signed in, and alice's, who clears what it stops."""

    def __init__(self, station: Station, alice: Signed, stream: ClientConnection) -> None:
        self.station, self.alice, self.stream = station, alice, stream
        for _ in range(2):  # the first one may be half a second old: nobody looked on
            assert self.shows(False, 60)

    def shows(self, is_stopped: bool, within_s: float) -> bool:
        """Whether a state says so."""
        until = time.monotonic() + within_s
        while time.monotonic() < until:
            message = json.loads(self.stream.recv(timeout=60))
            if message["op"] != "state":
                continue
            if is_stopped == any(drone["name"] == OF_THE_PAGE and drone["stopped_by"] for drone in message["drones"]):
                return True
        return False

    def say_by_stream(self) -> int:
        said_ns = time.monotonic_ns()
        self.stream.send(json.dumps({"op": "stop", "drone": OF_THE_PAGE}))
        return said_ns

    def say_by_request(self) -> int:
        """On a connection of its own, as from 50 ms away; without the network's own time."""
        said_ns = time.monotonic_ns() + int(AWAY_S * 1e9)
        host, port = self.station.place.split(":")
        wire = http.client.HTTPConnection(self.station.place)
        wire.sock = socket.create_connection((host, int(port)), timeout=60)
        time.sleep(AWAY_S)
        if self.station.context:
            wire.sock = self.station.context.wrap_socket(wire.sock, server_hostname=host)
        wire.request("POST", f"/api/v1/drones/{OF_THE_PAGE}/stop",
                     headers={"Authorization": f"Bearer {self.station.token}"})
        assert wire.getresponse().status == 202
        wire.close()
        return said_ns

    def clear(self) -> None:
        """Which ground, other than a stop, does not say again where the ledger had no room for it."""
        for _ in range(30):
            self.alice.say(f"drones/{OF_THE_PAGE}/clear_stop")
            if self.shows(False, 2):
                return
        raise AssertionError("a stop over the page is not cleared within a minute")

    def gauge(self, seconds: float) -> dict[str, list[float]]:
        """How long a stop takes until the page shows it, each way by turns; each is cleared."""
        took = {"stream": [], "request": []}
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for way, say in (("stream", self.say_by_stream), ("request", self.say_by_request)):
                said_ns = say()
                assert self.shows(True, 60)
                took[way].append((time.monotonic_ns() - said_ns) / 1e6)
                self.clear()
                time.sleep(0.03)
        return took


def gauge_ledger(config: pathlib.Path, seconds: float) -> list[float]:
    command = [BIN / "test_stop_gauge", "--config", config, "--drone", OF_THE_LEDGER, "--seconds", str(seconds)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=seconds + 60)
    reported = json.loads(done.stdout)
    assert reported["failed"] == 0
    return [stop["ms"] for stop in reported["stops"]]


class Window:
    """Some seconds of the flight, in which drones that stand are stopped every way there is."""

    def __init__(self, stopper: pathlib.Path, page: Page) -> None:
        self.begin_ns = time.monotonic_ns()
        with ThreadPoolExecutor() as beside:
            by_command = beside.submit(gauge_ledger, stopper, SECONDS - 2)
            by_page = page.gauge(SECONDS - 2)
            took = {"ledger": by_command.result(), **by_page}
        self.end_ns = time.monotonic_ns()
        self.stop_ms = {way: figures(ms) for way, ms in took.items()}

    def of(self, trace: pathlib.Path, kind: TraceKind) -> list:
        return [r for r in records(trace) if r.kind == kind and self.begin_ns <= r.t_ns <= self.end_ns]

    def two_way_ms(self, run: pathlib.Path) -> dict:
        return figures([(r.t_ns - r.stamp_ns) / 1e6 for r in self.of(run / "agent.trace", TraceKind.COMMAND_VERIFIED)])

    def holds(self, run: pathlib.Path) -> int:
        return sum(r.extra != NONE and r.id == FLYING for r in self.of(run / "link.trace", TraceKind.MODE))


def with_tls(out: pathlib.Path, station: Station) -> SecureStation:
    made = make(out / "made", "IP:127.0.0.1")
    listen = f'listen = "{station.place}"\n'
    table = f'{listen}tls_certificate = "{made}/page.pem"\ntls_key = "{made}/page.key"\n'
    restart(out, lambda text: text.replace(listen, table))
    return SecureStation(out, made)


@pytest.mark.skipif(not LONG, reason="runs with ./run-tests --long: flights of a minute")
@pytest.mark.parametrize("flood", FLOODS)
def test_a_stop_beside_a_flood_is_as_soon_as_a_command_and_nobody_holds(tmp_path, flood):
    flight = fly(tmp_path, "--drones", "5", "--shape", "manual", "--watch", "--operators", "alice")
    station, run = Station(tmp_path, flight), tmp_path / "run"
    if flood == "connections_tls":
        station = with_tls(tmp_path, station)
    alice = sign_in(station, tmp_path, "alice")
    for name in FLYERS:
        alice.say(f"drones/{name}/acquire")
        station.wait(name, holder("alice"))
        take_off(alice, name)
        x, y, _ = station.drone(name)["position"]
        corners = [{"x": round(x + dx, 3), "y": round(y + dy, 3)} for dx, dy in ((1, 0), (1, 1), (0, 1), (0, 0))]
        alice.say(f"drones/{name}/path", {"waypoints": corners * 50})
        station.wait(name, lambda drone: drone["phase"] == "path")
    host = next((user_dir(run, 1, "User1") / "signcerts").iterdir())
    control(as_user(run, 1, "Admin"), "enroll", "--msp", "Org1MSP", "--cert", host, OF_THE_LEDGER)
    stopper = enroll_operator(run, 1, "User2")
    with station.stream() as stream:
        page = Page(station, alice, stream)
        quiet = Window(stopper, page)
        command = [*FLOODS[flood](run, station), "--seconds", str(SECONDS)]
        flooding = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert json.loads(flooding.stdout.readline())["begins"]
        flooded = Window(stopper, page)
        did = json.loads(flooding.stdout.readline())
        assert flooding.wait(30) == 0
    phases = {name: station.drone(name)["phase"] for name in FLYERS}
    flight.send_signal(signal.SIGINT)
    ended = flight.wait(60)  # and its traces are whole
    bar_ms = quiet.two_way_ms(run)["p99"] + MARGIN_MS
    print(json.dumps({"flood": flood, "did": did, "bar_ms": round(bar_ms, 1),
                      "holds": {"quiet": quiet.holds(run), "flood": flooded.holds(run)},
                      "stop_ms": {"quiet": quiet.stop_ms, "flood": flooded.stop_ms},
                      "two_way_ms": {"quiet": quiet.two_way_ms(run), "flood": flooded.two_way_ms(run)}}))
    assert ended == 0 and set(phases.values()) == {"path"}, (phases, printed(tmp_path))
    assert did["sent"] >= LEAST.get(flood, 50), "there was no flood"
    if flood not in BEYOND_THE_BAR:
        assert not flooded.holds(run), "a drone held"
        assert all(ms["p99"] < bar_ms for ms in flooded.stop_ms.values()), (bar_ms, flooded.stop_ms)
    assert_nothing_left()
