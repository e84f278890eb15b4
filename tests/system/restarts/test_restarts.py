"""Processes are killed and stopped in mid-lap: what the drone does meanwhile, from the traces of link and of the simulator."""
import json
import math
import os
import pathlib
import random
import signal
import struct
import subprocess
import time

import pytest
from flights import (BIN, assert_nothing_left, fly, no_flight_outlives_its_test, our_processes, pid_of,
                     printed, result, wait_for_flight)
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
TIMEOUT_S = 120  # not a limit on speed: only how long a broken test may take
FLYING, LANDING = 3, 4  # LinkPhase
NONE, HOLD, LAND = 0, 1, 3  # FailsafeMode
AGENT_SILENT = 3  # FailsafeCause
LAND_AFTER_S, HOLD_GRACE_S = 5.0, 0.1  # onboard/link/core/settings.hpp
MAX_PLAN_S = 2.0 + 0.05  # the contract's and agent's limit, and how long a plan's last setpoint is flown
HALF_NS = 500_000_000
LOST_S = 0.25  # LinkSettings::health_gap_ns: a loop that is later calls itself unhealthy


def of_link(out: pathlib.Path) -> list[tuple]:
    """The traces of all of link's lives."""
    return sorted(r for trace in (out / "run").glob("link*.trace") for r in records(trace))


def modes(out: pathlib.Path) -> list[tuple[int, int, int, int]]:
    """Time, phase, failsafe mode and cause."""
    return [(r[0], r[4], r[3], int(r[6])) for r in of_link(out) if r[1] == TraceKind.MODE]


def late_turns(trace: list[tuple]) -> list[tuple[int, float]]:
    """When a turn of the loop was due, nearly, and how much more than its period later it began [s]."""
    late = []
    for begun_ns, kind, _, turns, _, due_ns, *packed in trace:
        if kind == TraceKind.LOOP_TURNS:
            for late_us in struct.unpack("<16H", struct.pack("<4d", *packed))[:turns]:
                if late_us > 1000:  # 65,535: that and more
                    late.append((due_ns, (begun_ns - due_ns) / 1e9 if late_us == 65535 else late_us / 1e6))
    return late


def assert_stayed_up(out: pathlib.Path, since_ns: int, until_ns: int) -> None:
    truth = [r for r in records(out / "run" / "sim.trace") if r[1] == TraceKind.TRUTH and since_ns < r[0] < until_ns]
    assert len(truth) > 10 and all(r[3] == 1 for r in truth), "it came down"
    landings = [m for m in modes(out) if since_ns < m[0] < until_ns and (m[1] == LANDING or m[2] >= LAND)]
    assert landings == []


def wait_for_another(out: pathlib.Path, program: str, pid: int) -> int:
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        for other, name in our_processes().items():
            if name == program and other != pid:
                return other
        time.sleep(0.02)
    pytest.fail(f"{program} does not come back; there are {sorted(our_processes().values())}. The flight says:\n{printed(out)[-4000:]}")


def kill(out: pathlib.Path, program: str) -> tuple[int, int]:
    """When, and the process that took its place."""
    pid = pid_of(program)
    at_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL)
    return at_ns, wait_for_another(out, program, pid)


def steal_s() -> float:
    return int(pathlib.Path("/proc/stat").read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


def kill_agent_in_flight(out: pathlib.Path, kills: int) -> dict:
    """One flight; what became of it, the figures of its kills."""
    flight = fly(out, "--seconds", str(3.2 * kills + 10), "--storage", "tmpfs")
    wait_for_flight(out, flight)
    stolen_s = steal_s()
    time.sleep(2)
    at_ns = []
    for _ in range(kills):
        at_ns.append(kill(out, "ledgerline-agent")[0])
        time.sleep(max(0, random.uniform(2.6, 3.4) - (time.monotonic_ns() - at_ns[-1]) / 1e9))
    end_ns = time.monotonic_ns()
    stolen_s = steal_s() - stolen_s
    assert flight.wait(TIMEOUT_S) == 0, printed(out)
    restarts = result(out)["restarts"]
    # Who is killed with one of RouDi's locks takes RouDi along, and link is started with the new one (docs/failsafe.md).
    assert restarts["agent"] >= kills and restarts.get("roudi", 0) == restarts.get("link", 0)
    assert_stayed_up(out, at_ns[0], end_ns)
    trace = of_link(out)
    gaps_s = []
    for begin, end in zip(at_ns, [*at_ns[1:], end_ns]):
        flown = [begin, *(r[0] for r in trace if r[1] == TraceKind.COMMAND_APPLIED and begin < r[0] < end), end]
        gap_s, gap_end = max(((b - a) / 1e9, b) for a, b in zip(flown, flown[1:]))
        assert gap_end < end, "not taken back before the next kill"
        gaps_s.append(gap_s)
    late = [(t, s) for t, s in late_turns(trace) if at_ns[0] < t < end_ns]
    # Late turns come in bursts, so what is counted is half seconds that have any: those behind a kill, and those elsewhere.
    since_kill = [(max(k for k in at_ns if k <= t), t, s) for t, s in late]
    at_kills = {k: max(s for other, t, s in since_kill if other == k and t - k < HALF_NS) for k, t, _ in since_kill if t - k < HALF_NS}
    elsewhere = {(k, (t - k) // HALF_NS) for k, t, _ in since_kill if t - k >= HALF_NS}
    link = json.loads((out / "run" / "link.summary.json").read_text())
    assert all(drone["states_lost"] == 0 for drone in link["drones"]), "shared memory ran out"
    return {"kills": kills, "roudi": restarts.get("roudi", 0), "gaps_s": gaps_s, "late_at_kills_s": list(at_kills.values()), "late_elsewhere": len(elsewhere),
            "flown_s": (end_ns - at_ns[0]) / 1e9, "steal_s": stolen_s, "real_time": link["realtime"],
            "leaked": json.loads((out / "run" / "roudi.summary.json").read_text())["leaked"]}


def test_an_agent_that_is_killed_at_any_moment_is_taken_back_and_disturbs_link_nowhere(tmp_path):
    kills, per_flight = (1000, 150) if LONG else (3, 3)  # a battery lasts twelve minutes
    random.seed(6)
    flights = []
    while (left := kills - sum(f["kills"] for f in flights)) > 0:
        flights.append(kill_agent_in_flight(tmp_path / f"flight{len(flights)}", min(left, per_flight)))
    gaps_s = sorted(gap for f in flights for gap in f["gaps_s"])
    at_kills = [s for f in flights for s in f["late_at_kills_s"]]
    elsewhere, flown_s = (sum(f[key] for f in flights) for key in ("late_elsewhere", "flown_s"))
    leaked = sum(f["leaked"] for f in flights)
    by_chance = elsewhere / (flown_s - 0.5 * kills) * 0.5 * kills
    print(f"{kills} kills: without a command median {gaps_s[len(gaps_s) // 2]:.2f} s, at most {gaps_s[-1]:.2f} s; half seconds with a turn of "
          f"link's loop later than 1 ms: {len(at_kills)} after a kill (maximum {1e3 * max(at_kills, default=0):.1f} ms), "
          f"{elsewhere} elsewhere in {flown_s:.0f} s, steal {sum(f['steal_s'] for f in flights):.1f} s; {leaked} chunks leaked, "
          f"{1000 * leaked / kills:.1f} per 1,000 kills; RouDi ended with {sum(f['roudi'] for f in flights)}", flush=True)
    assert max(at_kills, default=0) < LOST_S
    if LONG and all(f["real_time"] for f in flights):  # a few kills say nothing of how often
        assert len(at_kills) <= by_chance + 3 * math.sqrt(by_chance) + 3, "more than the machine itself is late"
    assert_nothing_left()


def test_with_a_stopped_agent_the_plan_is_flown_out_and_then_held_every_time(tmp_path):
    trials = 100 if LONG else 1
    flight = fly(tmp_path, "--seconds", str(6 * trials + 8), "--storage", "tmpfs")
    wait_for_flight(tmp_path, flight)
    agent = pid_of("ledgerline-agent")
    stopped_ns = []
    for _ in range(trials):
        time.sleep(random.uniform(2.5, 3))
        stopped_ns.append(time.monotonic_ns())
        os.kill(agent, signal.SIGSTOP)
        time.sleep(3)
        os.kill(agent, signal.SIGCONT)
    end_ns = time.monotonic_ns() + 2_000_000_000
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    assert_stayed_up(tmp_path, stopped_ns[0], end_ns)
    held_s = []
    for begin in stopped_ns:
        seen = [m for m in modes(tmp_path) if begin < m[0] < begin + 3_000_000_000]
        assert seen and {m[2] for m in seen} == {HOLD} and seen[-1][3] == AGENT_SILENT, seen
        held_s.append((seen[0][0] - begin) / 1e9)
        after = [m[2] for m in modes(tmp_path) if begin + 3_000_000_000 < m[0] < begin + 5_400_000_000]
        assert after and after[-1] == NONE, "it flies on when agent does"
    print(f"{trials} trials: from SIGSTOP to hold {min(held_s):.2f} to {max(held_s):.2f} s", flush=True)
    assert min(held_s) > 0.3, "the plan in hand is flown"
    assert max(held_s) < MAX_PLAN_S + HOLD_GRACE_S
    assert_nothing_left()


def test_an_agent_that_stays_away_means_a_landing(tmp_path):
    flight = fly(tmp_path, "--laps", "50")
    wait_for_flight(tmp_path, flight)
    begin = time.monotonic_ns()
    agent = pid_of("ledgerline-agent")
    os.kill(agent, signal.SIGSTOP)
    time.sleep(LAND_AFTER_S + 8)
    os.kill(agent, signal.SIGCONT)
    assert flight.wait(TIMEOUT_S) == 1, printed(tmp_path)
    seen = [m for m in modes(tmp_path) if m[0] > begin and m[1] in (FLYING, LANDING)]
    assert [m[2:] for m in seen] == [(HOLD, AGENT_SILENT), (LAND, AGENT_SILENT)], seen
    assert (seen[1][0] - seen[0][0]) / 1e9 == pytest.approx(LAND_AFTER_S, abs=0.05)
    truth = [r for r in records(tmp_path / "run" / "sim.trace") if r[1] == TraceKind.TRUTH]
    assert truth[-1][3] == 0 and any(r[0] < begin + 12_000_000_000 and r[0] > begin and r[3] == 0 for r in truth)
    assert_nothing_left()


def hardest_m_s2(truth: list[tuple], begin: int, end: int) -> float:
    """Acceleration over a tenth of a second."""
    points, last = [], 0
    for r in truth:
        if begin < r[0] < end and r[0] - last >= 99_000_000:
            points.append((r[0] / 1e9, r[6:9]))
            last = r[0]
    speeds = [((t1 + t0) / 2, [(b - a) / (t1 - t0) for a, b in zip(p0, p1)]) for (t0, p0), (t1, p1) in zip(points, points[1:])]
    return max(math.dist(v0, v1) / (t1 - t0) for (t0, v0), (t1, v1) in zip(speeds, speeds[1:]))


def test_a_link_that_is_killed_is_back_in_the_air_without_a_jerk_and_the_flight_goes_on(tmp_path):
    kills = 100 if LONG else 2
    flight = fly(tmp_path, "--seconds", str(5 * kills + 8), "--storage", "tmpfs")
    wait_for_flight(tmp_path, flight)
    at_ns = []
    for _ in range(kills):
        time.sleep(random.uniform(3, 4))
        at_ns.append(kill(tmp_path, "ledgerline-link")[0])
    end_ns = time.monotonic_ns() + 3_000_000_000
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    report = result(tmp_path)
    assert report["restarts"] == {"link": kills}
    assert_stayed_up(tmp_path, at_ns[0], end_ns)
    # A link that is killed takes its newest records along.
    found = [[m[0] for m in modes(tmp_path) if m[1] == FLYING and at < m[0] < until] for at, until in zip(at_ns, [*at_ns[1:], end_ns])]
    away_s = [(times[0] - at) / 1e9 for at, times in zip(at_ns, found) if times]
    assert found[-1]
    truth = [r for r in records(tmp_path / "run" / "sim.trace") if r[1] == TraceKind.TRUTH]
    hardest = max(hardest_m_s2(truth, at, at + 3_000_000_000) for at in at_ns)
    usual = hardest_m_s2(truth, at_ns[0] - 2_500_000_000, at_ns[0])
    print(f"{kills} kills of link: back after {min(away_s):.2f} to {max(away_s):.2f} s; hardest acceleration {hardest:.1f} m/s2, "
          f"{usual:.1f} before the first; {report['drones'][0]['cross_track_m']['max']:.2f} m off its path at most", flush=True)
    assert hardest < 4, "link's limit of acceleration"
    assert_nothing_left()


def test_without_roudi_the_flight_goes_on_and_all_three_come_back_in_order_when_link_dies_too(tmp_path):
    flight = fly(tmp_path, "--seconds", "25", "--storage", "tmpfs")
    wait_for_flight(tmp_path, flight)
    before = {name: pid for pid, name in our_processes().items()}
    os.kill(pid_of("ledgerline-roudi"), signal.SIGKILL)
    lost_ns = time.monotonic_ns()
    time.sleep(4)
    now = {name: pid for pid, name in our_processes().items()}
    assert "ledgerline-roudi" not in now
    assert [now[name] for name in ("ledgerline-link", "ledgerline-agent")] == [before[name] for name in ("ledgerline-link", "ledgerline-agent")]
    killed_ns, _ = kill(tmp_path, "ledgerline-link")
    wait_for_another(tmp_path, "ledgerline-agent", before["ledgerline-agent"])
    back_ns = time.monotonic_ns() + 2_000_000_000
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    assert result(tmp_path)["restarts"] == {"roudi": 1, "link": 1, "agent": 1}
    said = [line.split()[0] for line in printed(tmp_path).splitlines() if "is started again" in line]
    assert said == ["roudi", "link", "agent"]
    assert_stayed_up(tmp_path, lost_ns, back_ns)
    assert [m for m in modes(tmp_path) if lost_ns < m[0] < killed_ns] == [], "nobody misses RouDi"
    assert_nothing_left()


def test_any_process_may_stand_still_for_a_moment(tmp_path):
    flight = fly(tmp_path, "--seconds", "26")
    wait_for_flight(tmp_path, flight)
    begin = time.monotonic_ns()
    for program in ("link", "roudi", "ground", "node"):
        pid = pid_of(f"ledgerline-{program}")
        time.sleep(3)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(1.5)
        os.kill(pid, signal.SIGCONT)
    end = time.monotonic_ns() + 3_000_000_000
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    assert result(tmp_path)["restarts"] == {}
    assert_stayed_up(tmp_path, begin, end)
    assert_nothing_left()


def test_on_the_ground_link_ends_when_roudi_is_gone_so_that_it_can_be_restarted(tmp_path):
    config = tmp_path / "link.toml"
    config.write_text('[[drone]]\nname = "tello1"\naddress = "127.0.0.2"\n')

    def start(*command) -> subprocess.Popen:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert json.loads(process.stdout.readline())["ready"]
        return process

    for _ in range(2):
        roudi = start(BIN / "ledgerline-roudi")
        link = start(BIN / "ledgerline-link", "--config", config)
        roudi.kill()
        assert link.wait(TIMEOUT_S) == 0
        roudi.wait()
    roudi = start(BIN / "ledgerline-roudi")  # clears up behind the one that was killed
    roudi.terminate()
    assert roudi.wait(TIMEOUT_S) == 0
    assert_nothing_left()
