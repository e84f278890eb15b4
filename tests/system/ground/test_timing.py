"""ledgerline timing on a short flight: while it goes on, and afterwards."""
import json
import os
import pathlib
import re
import subprocess

import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, printed, wait_for_flight

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
STAGES = ["ring", "batch", "endorse", "order", "deliver", "control", "queue", "command_endorse", "command_order",
          "command_deliver", "wake", "verify", "handover", "apply", "send", "device"]


def timing(*options: object) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / "ledgerline", "timing", *map(str, options)], capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The directory of a run, and what --live said while it flew."""
    out = tmp_path_factory.mktemp("timing")
    flight = fly(out, "--seconds", "6")
    wait_for_flight(out, flight)
    live = timing(out / "run", "--live", "--seconds", "5", "--every", "1")
    assert flight.wait(90) == 0, printed(out)
    assert_nothing_left()
    return out / "run", live


def test_live_shows_the_flight_while_it_goes_on(flown):
    _, live = flown
    assert live.returncode == 0, live.stderr
    tables = live.stdout.split("stage, ms")[1:]
    assert len(tables) >= 3, live.stdout
    counts = [int(re.search(r"two_way .* (\d+) *\n", table).group(1)) for table in tables if re.search(r"two_way .*\d", table)]
    assert counts and counts[-1] > 30, live.stdout
    assert "headroom" in tables[1] and "link/loop" in live.stdout


def test_a_recorded_flight_has_every_stage_of_the_walk(flown):
    run, _ = flown
    done = timing(run, "--json", run / "t.json", "--html", run / "t.html", "--perfetto", run / "t.perfetto.json",
                  "--limit", "p99.two_way=60s", "--limit", "headroom=0%")
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((run / "t.json").read_text())
    assert [stage["name"] for stage in report["stages"]] == STAGES
    flights = {s["name"]: s for s in report["stages"] + report["totals"]}
    for name in STAGES + ["two_way", "age", "setpoint", "datagram"]:
        figures = flights[name]
        assert figures["count"] > 100, figures
        assert 0 <= figures["p50"] <= figures["p95"] <= figures["p99"] <= figures["p99.9"] <= figures["max"], figures
    summary = json.loads((run / "agent.summary.json").read_text())
    verified = sum(d["commands"]["verified"] for d in summary["drones"])
    assert abs(flights["two_way"]["count"] - verified) <= 0.02 * verified, "walks are lost on the way"
    # The stages that every sample has come by add up to the whole way, on average; medians nearly so.
    assert sum(flights[s]["p50"] for s in STAGES) == pytest.approx(flights["age"]["p50"], rel=0.5)
    assert report["records"]["backwards"] == 0, report["records"]
    loop = json.loads((run / "link.summary.json").read_text())["loop"]
    assert report["loop"]["turns"] == loop["cycles"] and report["loop"]["lost"] == 0
    assert set(report["budget"]["programs"]) == {"roudi", "node", "sim", "link", "agent", "ground"}
    assert report["budget"]["headroom_percent"] == pytest.approx(200 - sum(report["budget"]["programs"].values()), abs=0.1)
    loop = next(t for t in report["threads"] if t["program"] == "link" and t["name"] == "loop")
    assert loop["voluntary_switches"] > 1000 and loop["cpu_percent"] > 0
    assert not re.search(r"(src|href)=", (run / "t.html").read_text()), "the page needs a network"


def test_the_perfetto_file_is_of_chromes_form(flown):
    run, _ = flown
    assert timing(run, "--perfetto", run / "t.perfetto.json").returncode == 0
    events = json.loads((run / "t.perfetto.json").read_text())["traceEvents"]
    for event in events:
        assert {"ph", "ts", "pid", "tid", "name"} <= set(event), event
        assert event["ph"] in "XCM" and event["ts"] >= 0, event
        assert event["ph"] != "X" or event["dur"] >= 0, event
    assert {e["name"] for e in events if e["ph"] == "X"} == {"sample", *STAGES}
    assert sum(e["ph"] == "C" for e in events) > 100


def test_exit_codes_tell_limits_usage_and_files_apart(flown, tmp_path):
    run, _ = flown
    broken = timing(run, "--limit", "p50.two_way=1us")
    assert broken.returncode == 1 and "NOT KEPT p50.two_way=1us" in broken.stdout
    for unknown in ("p99.aply=1ms", "p98.apply=1ms", "cpu.link=1ms"):
        usage = timing(run, "--limit", unknown)
        assert usage.returncode == 2 and unknown in usage.stderr, usage.stderr
    assert timing().returncode == 2
    nothing = timing(tmp_path)
    assert nothing.returncode == 3 and "link.trace" in nothing.stderr and "fault run --real" in nothing.stderr
    (tmp_path / "run").symlink_to(run)  # as `fault run --real` leaves it
    assert timing(tmp_path).returncode == 0


def test_the_self_test_runs_beside_cyclictest(tmp_path):
    done = timing("--self-test", "--seconds", "2", "--json", tmp_path / "t.json")
    assert done.returncode in (0, 1), done.stderr
    assert "enough for link: p99.9 of link's loop at most 200 us" in done.stdout
    report = json.loads((tmp_path / "t.json").read_text())
    assert report["loop_ms"]["count"] == 2000
    if report["cyclictest_ms"] is None:
        assert report["why_no_cyclictest"] in done.stdout
        pytest.skip(report["why_no_cyclictest"])
    assert report["cyclictest_ms"]["count"] == pytest.approx(2000, rel=0.02)
    if not report["fifo"]:
        assert "SCHED_FIFO" in done.stdout
