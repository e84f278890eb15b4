"""The whole way with the real processes: ledgerline fly as a person starts it."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import time

import flights
import pytest
from fabric import needs_fabric
from flights import (BIN, assert_nothing_left, control, enroll_operator, fly, no_flight_outlives_its_test, our_processes,
                     pid_of, printed, result, wait_for_flight)
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
QUANTILES = {"p5", "q1", "median", "q3", "p95", "p99", "max", "count"}


def applied(out: pathlib.Path, drone: int) -> list[int]:
    """Sequence numbers of the plans that link flew, in the order in which it did."""
    return [r.id for r in records(out / "run" / "link.trace") if r.kind == TraceKind.COMMAND_APPLIED and r.drone == drone]


def assert_counts_add_up(drone: dict) -> None:
    states, commands = drone["states"], drone["commands"]
    assert states["sampled"] > 100
    assert states["sampled"] == states["on_ledger"] + states["merged"] + states["dropped"]
    assert commands["sent"] == commands["on_ledger"]
    assert commands["on_ledger"] == commands["refused"] + commands["applied"] + commands["late"] + commands["dropped"]
    assert commands["refused"] + commands["dropped"] == sum(commands["reasons"].values())
    assert set(commands["reasons"]) <= {"too_old", "superseded"}, "nothing but a ledger that stood still may cost a command"
    assert commands["applied"] > 0.9 * commands["sent"]


LEDGERS = ["embedded", "fabric"] if LONG else ["fabric"]  # for what asks most of one


def programs_of_the_script(folder: pathlib.Path) -> pathlib.Path:
    """A bin/ with what ./fly builds for a flight, and nothing else."""
    script = (pathlib.Path(__file__).resolve().parents[3] / "fly").read_text()
    names = re.search(r"^programs=\(ledgerline-{(.*)}\)$", script, re.M).group(1).split(",")
    for part in ("bin", "libexec/ledgerline"):
        (folder / part).mkdir(parents=True)
        for name in ["ledgerline"] + [f"ledgerline-{name}" for name in names]:
            if (BIN.parent / part / name).exists():
                shutil.copy(BIN.parent / part / name, folder / part / name)
    return folder / "bin"


@pytest.mark.essential
@pytest.mark.parametrize("drones,shape,ledger", [(3, "triangle", "embedded"), (1, "x", "fabric")])
def test_drones_finish_their_path_and_land(tmp_path, monkeypatch, drones, shape, ledger):
    if ledger == "fabric":
        needs_fabric()
    else:
        monkeypatch.setattr(flights, "BIN", programs_of_the_script(tmp_path / "built"))
        monkeypatch.setenv("LEDGERLINE_BIN", str(flights.BIN))
    flight = fly(tmp_path, "--drones", str(drones), "--shape", shape, "--laps", "1", "--ledger", ledger)
    assert flight.wait(180) == 0, printed(tmp_path)
    report = result(tmp_path)
    assert report["ok"] is True
    assert [d["id"] for d in report["drones"]] == [f"tello{k + 1}" for k in range(drones)]
    for drone in report["drones"]:
        assert set(drone["two_way_ms"]) >= QUANTILES and set(drone["age_ms"]) >= QUANTILES
        assert 0 < drone["two_way_ms"]["median"] <= drone["age_ms"]["median"]
        assert len(drone["lap_s"]) == 1
        assert 0 < drone["cross_track_m"]["rms"] <= drone["cross_track_m"]["max"] < 0.5
        assert_counts_add_up(drone)
        transitions = drone["transitions"]
        assert transitions["made"] == transitions["on_ledger"] >= 5 and transitions["lost"] == 0, transitions
        order = applied(tmp_path, int(drone["id"].removeprefix("tello")))
        assert len(order) == drone["commands"]["applied"]
        assert all(a < b for a, b in zip(order, order[1:])), "applied out of order"
    agent = json.loads((tmp_path / "run" / "agent.summary.json").read_text())
    assert agent["integrity_violations"] == 0, (agent["integrity_violations_by_kind"], printed(tmp_path))
    assert report["ledger"]["kind"] == ledger and report["ledger"]["blocks"] > 100
    assert report["messages_per_s"] > 30 and report["transactions_per_s"] > 10
    pages = list((tmp_path / "run").glob("*.html"))
    assert len(pages) == 1
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", pages[0].read_text()), "the page needs a network"
    assert_nothing_left()


FLYING = 3  # LinkPhase


def gaps_in(commits_ns: list[int]) -> list[tuple[int, int]]:
    """When the whole ledger stood still, as the commits themselves witness: ten a second, none for 0.35 s (a stalled disk or
    machine)."""
    gaps = [(a, b) for a, b in zip(commits_ns, commits_ns[1:]) if b - a > 350_000_000]
    assert sum(b - a for a, b in gaps) < (commits_ns[-1] - commits_ns[0]) / 4, "a ledger that stands still shows nothing"
    return gaps


def taken_over(out: pathlib.Path, drones: range, commits_ns: list[int], gaps: list[tuple[int, int]]) -> list[str]:
    """When between these commits, but for the gaps, the failsafe took over one of them while it flew, and why."""
    return [f"tello{r[2]} after {(r[0] - commits_ns[0]) / 1e9:.1f} s: mode {r[3]}, cause {r[6]:.0f}"
            for r in records(out / "run" / "link.trace")
            if r.kind == TraceKind.MODE and r[4] == FLYING and r[3] != 0 and r[2] in drones
            and commits_ns[0] < r[0] < commits_ns[-1]
            and not any(a < r[0] < b + 600_000_000 for a, b in gaps)]


@pytest.mark.parametrize("ledger", LEDGERS)
def test_a_drone_that_two_operators_fight_over_does_not_touch_its_neighbours(tmp_path, ledger):
    if ledger == "fabric":
        needs_fabric()
    flight = fly(tmp_path, "--drones", "16", "--seconds", "20", "--ledger", ledger)
    wait_for_flight(tmp_path, flight)
    run = tmp_path / "run"
    rival = enroll_operator(run, 3, "User1")
    control(run / "admin.toml", "grant", "--msp", "Org3MSP", "--fly", "--max-priority", "1000", "tello16")
    fight = subprocess.run([BIN / "test_fight", "--config", run / "operator.toml", rival,
                            "--drone", "tello16", "--hz", "10", "--seconds", "10"],
                           stdout=subprocess.PIPE, text=True, check=True, timeout=60)
    commits_ns = json.loads(fight.stdout)["committed_ns"]
    assert len(commits_ns) > 80, fight.stdout
    flight.wait(120)
    report = result(tmp_path)
    print(len(commits_ns), "changes committed", report["drones"][0]["two_way_ms"])
    assert [d["id"] for d in report["drones"] if not d["lap_s"]] == ["tello16"], printed(tmp_path)
    assert taken_over(tmp_path, range(1, 16), commits_ns, gaps_in(commits_ns)) == []
    # It holds once, where its pilot is lost first: in a gap, too, and before a client has heard of that commit.
    assert taken_over(tmp_path, range(16, 17), [0, commits_ns[-1]], []), "the test sees a drone that loses its pilot"
    assert_nothing_left()


def test_figures_that_cannot_be_written_are_said_before_anything_flies(tmp_path):
    refused = subprocess.run([BIN / "ledgerline", "fly", "--out", tmp_path / "run", "--json", "/proc/no/x.json"], capture_output=True, text=True, timeout=60)
    assert refused.returncode == 1 and "--json: cannot write /proc/no/x.json" in refused.stderr, refused.stderr
    assert not (tmp_path / "run" / "link.toml").exists()


def test_ctrl_c_lands_the_drone_and_ends_every_process(tmp_path):
    flight = fly(tmp_path, "--laps", "50")
    wait_for_flight(tmp_path, flight)
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) != 0
    report = result(tmp_path)
    assert report["ok"] is False and report["why"]
    sim = json.loads((tmp_path / "run" / "sim.summary.json").read_text())
    assert sim["drones"][0]["landed"] is True
    assert_nothing_left()


def test_a_stop_on_the_ledger_lands_the_drone(tmp_path):
    flight = fly(tmp_path, "--laps", "50")
    wait_for_flight(tmp_path, flight)
    stop = subprocess.run([BIN / "ledgerline", "control", "--config", tmp_path / "run" / "operator.toml", "stop", "tello1"],
                          capture_output=True, text=True, timeout=30)
    assert stop.returncode == 0 and re.search(r"^transaction [0-9a-f]{64}$", stop.stderr, re.MULTILINE), stop.stderr
    assert flight.wait(60) == 1, printed(tmp_path)
    assert "stopped by" in result(tmp_path)["why"]
    assert json.loads((tmp_path / "run" / "agent.summary.json").read_text())["stops_applied"]["on_ledger"] == 1
    sim = json.loads((tmp_path / "run" / "sim.summary.json").read_text())
    assert sim["drones"][0]["landed"] is True
    assert_nothing_left()


@pytest.mark.parametrize("victim", ["node", "ground"])
def test_a_crash_of_one_process_lands_the_drone_and_is_reported(tmp_path, victim):
    flight = fly(tmp_path, "--laps", "50")
    wait_for_flight(tmp_path, flight)
    os.kill(pid_of(f"ledgerline-{victim}"), signal.SIGKILL)
    assert flight.wait(90) != 0
    report = result(tmp_path)
    assert report["ok"] is False and victim in report["why"]
    sim = json.loads((tmp_path / "run" / "sim.summary.json").read_text())
    assert sim["drones"][0]["landed"] is True
    assert_nothing_left()


def test_killing_fly_itself_leaves_nothing_behind(tmp_path):
    flight = fly(tmp_path, "--laps", "50")
    wait_for_flight(tmp_path, flight)
    flight.kill()
    flight.wait(10)
    deadline = time.monotonic() + 30
    while our_processes() and time.monotonic() < deadline:
        time.sleep(0.2)
    assert our_processes() == {}
    # Whatever shared memory a killed run left, the next one cleans up and flies.
    again = fly(tmp_path / "again", "--laps", "1")
    assert again.wait(120) == 0, printed(tmp_path / "again")
    assert_nothing_left()


def test_a_second_run_at_the_same_time_is_refused(tmp_path):
    first = fly(tmp_path / "first", "--laps", "1")
    wait_for_flight(tmp_path / "first", first)
    second = fly(tmp_path / "second", "--laps", "1")
    assert second.wait(20) != 0
    assert re.search("already|another", printed(tmp_path / "second"))
    assert first.wait(120) == 0, printed(tmp_path / "first")
    assert_nothing_left()
