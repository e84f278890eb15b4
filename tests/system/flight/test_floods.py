"""A stop beside each flood of the embedded ledger, while four drones fly: how long it takes, and whether a drone ever held.

The figures are ratios to the quiet time of the same flight, since the machine's own speed is nobody's. A flood of the page would be
one more entry of FLOODS: a command that prints a line of JSON when it begins and one when it ends."""
import json
import os
import subprocess
import time

import pytest
from flights import (BIN, FLYING, HOLD, as_user, assert_nothing_left, enroll_operator, fly, no_flight_outlives_its_test, printed, result,
                     wait_for_flight)
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
DRONES = 4
SECONDS = 20       # of each flood, and of the quiet time before it
MARGIN_MS = 100    # that a stop may take beyond the quiet two-way's p99
ON_THE_GROUND = "tello9"  # enrolled as all of tello1 to tello16, and not among those that fly

FLOODS = {
    "urgent": lambda run: [BIN / "test_flood", "--config", as_user(run, 3, "User2"), "urgent", "--seconds", str(SECONDS)],
    "more_than_it_can": lambda run: [BIN / "test_flood", "--config", as_user(run, 3, "User2"), "urgent", "--per-second", "2000",
                                     "--seconds", str(SECONDS)],
    "askers": lambda run: [BIN / "test_flood", "--config", as_user(run, 3, "User2"), "askers", "--seconds", str(SECONDS)],
}
# More requests than two cores answer: it flies to its end, and each stop is on the ledger, but how soon is the machine's.
BEYOND_THE_BAR = {"more_than_it_can"}


def quantile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def gauge(config) -> dict:
    done = subprocess.run([BIN / "test_stop_gauge", "--config", config, "--drone", ON_THE_GROUND, "--seconds", str(SECONDS - 2)],
                          stdout=subprocess.PIPE, text=True, check=True, timeout=SECONDS + 60)
    return json.loads(done.stdout)


def figures(ms: list[float]) -> dict:
    return {"p50": round(quantile(ms, 0.5), 1), "p99": round(quantile(ms, 0.99), 1), "count": len(ms)}


@pytest.mark.skipif(not LONG, reason="runs with ./run-tests --long: flights of a minute")
@pytest.mark.parametrize("flood", FLOODS)
def test_a_stop_beside_a_flood_is_as_soon_as_a_command_and_nobody_holds(tmp_path, flood):
    flight = fly(tmp_path, "--drones", str(DRONES), "--seconds", str(2 * SECONDS + 40))
    wait_for_flight(tmp_path, flight)
    run = tmp_path / "run"
    stopper = enroll_operator(run, 1, "User2")
    quiet_ns, quiet = time.monotonic_ns(), gauge(stopper)
    quiet_end_ns = time.monotonic_ns()
    flooding = subprocess.Popen(FLOODS[flood](run), stdout=subprocess.PIPE, text=True)
    assert json.loads(flooding.stdout.readline())["begins"]
    flood_ns, flooded = time.monotonic_ns(), gauge(stopper)
    flood_end_ns = time.monotonic_ns()
    did = json.loads(flooding.stdout.readline())
    assert flooding.wait(30) == 0
    flying = flight.poll() is None
    assert flight.wait(200) == 0, printed(tmp_path)
    commands = [r for r in records(run / "agent.trace") if r.kind == TraceKind.COMMAND_VERIFIED]
    two_way = lambda begin, end: [(r.t_ns - r.stamp_ns) / 1e6 for r in commands if begin <= r.t_ns <= end]
    holds = [r.t_ns for r in records(run / "link.trace") if r.kind == TraceKind.MODE and r.extra == HOLD and r.id == FLYING]
    held = [t_ns for t_ns in holds if flood_ns <= t_ns <= flood_end_ns]
    stop_ms = {when: figures([stop["ms"] for stop in told["stops"]]) for when, told in (("quiet", quiet), ("flood", flooded))}
    two_way_ms = {"quiet": figures(two_way(quiet_ns, quiet_end_ns)), "flood": figures(two_way(flood_ns, flood_end_ns))}
    print(json.dumps({"flood": flood, "did": did, "stop_ms": stop_ms, "two_way_ms": two_way_ms, "holds": len(held), "holds_before": len(holds) - len(held),
                      "stop_p99_to_quiet_two_way_p99": round(stop_ms["flood"]["p99"] / two_way_ms["quiet"]["p99"], 2),
                      "flood_to_quiet": {"stop_p50": round(stop_ms["flood"]["p50"] / stop_ms["quiet"]["p50"], 2),
                                         "two_way_p50": round(two_way_ms["flood"]["p50"] / two_way_ms["quiet"]["p50"], 2)}}))
    assert flying, "the flight ended before the flood did"
    assert did["sent"] > 50, "there was no flood"
    assert flooded["failed"] == 0
    if flood not in BEYOND_THE_BAR:
        assert not held, "a drone held"
        assert stop_ms["flood"]["p99"] < two_way_ms["quiet"]["p99"] + MARGIN_MS
    assert result(tmp_path)["ok"]
    assert_nothing_left()
