"""Whole flights with the proxy between link and the simulator, and between agent, ground and the ledger."""
import json
import pathlib
import re
import subprocess
import time

import pytest

from flights import (BIN, assert_nothing_left, fly, no_flight_outlives_its_test, printed, result)
from proxies import tell
from trace_file import TraceKind, records

FLYING = 3  # LinkPhase
NONE, HOLD = 0, 1  # FailsafeMode
TIMEOUT_S = 120  # not a limit on speed: only how long a broken test may take


def summary(out: pathlib.Path) -> dict:
    return json.loads((out / "run" / "hil-proxy.summary.json").read_text())


def switched_ns(out: pathlib.Path, command: str) -> int:
    return next(s["t_ns"] for s in summary(out)["switched"] if s["command"] == command)


def wait_for_path(out: pathlib.Path, flight: subprocess.Popen, percent: int) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        seen = [int(p) for p in re.findall(r"tello1\b.*?\bpath (\d+) %", printed(out))]
        if seen and max(seen) >= percent:
            return
        assert flight.poll() is None and time.monotonic() < deadline, printed(out)
        time.sleep(0.05)


def test_a_flight_through_delays_loss_and_duplicates_holds_while_ground_is_stalled_and_finishes(tmp_path):
    script = tmp_path / "faults.toml"
    drone = "drone tello1 both delay 10ms, jitter uniform 0ms 10ms, loss 2%, duplicate 10% 5ms, reorder 5% 20ms"
    script.write_text(f'[[fault]]\nat_s = 0\ndo = "{drone}"\n[[fault]]\nat_s = 0\ndo = "server * both delay 10ms"\n')
    flight = fly(tmp_path, "--proxy", "--faults", str(script), "--laps", "1", "--speed", "1.0", "--storage", "tmpfs")
    wait_for_path(tmp_path, flight, 10)
    tell(tmp_path / "run" / "faults.sock", "server ground* both stall")
    time.sleep(1.5)
    tell(tmp_path / "run" / "faults.sock", "server ground* both stall off")
    assert flight.wait(TIMEOUT_S) == 0, printed(tmp_path)
    report = result(tmp_path)
    assert report["ok"] and report["asked"]["faults"]["file"] == str(script)
    switched = [one["command"] for one in report["asked"]["faults"]["switched"]]
    assert switched[:2] == [drone, "server * both delay 10ms"] and switched[-1] == "server ground* both stall off"
    assert "server ground* both stall off" in printed(tmp_path)
    drone = report["drones"][0]
    # A state is endorsed, ordered and reported, the command made from it too: at least six times 10 ms.
    assert drone["two_way_ms"]["p5"] > 60
    trace = records(tmp_path / "run" / "link.trace")
    stalled, on = (switched_ns(tmp_path, f"server ground* both stall{off}") for off in ("", " off"))
    modes = [(r[0], r[3]) for r in trace if r[1] == TraceKind.MODE and r[4] == FLYING and stalled < r[0] < on + 3_000_000_000]
    assert [m for _, m in modes][:2] == [HOLD, NONE], modes
    assert modes[0][0] < on < modes[1][0]
    applied = [r[0] for r in trace if r[1] == TraceKind.COMMAND_APPLIED]
    gap_s = max(b - a for a, b in zip(applied, applied[1:]) if b > stalled) / 1e9
    print(f"two-way {drone['two_way_ms']['median']:.0f} ms; hold {(modes[0][0] - stalled) / 1e9:.2f} s after the stall's begin, on "
          f"{(modes[1][0] - on) / 1e9:.2f} s after its end, {gap_s:.2f} s without a command; {drone['cross_track_m']['max']:.2f} m "
          f"off the path at most", flush=True)
    said = summary(tmp_path)
    one = said["drones"][0]
    assert all(one[way][what] > 0 for way in ("to", "state") for what in ("lost", "duplicated", "reordered"))
    hosts = [host + peer for host in ("agent", "ground") for peer in ("", "-orderer1", "-endorser2", "-endorser3")]
    assert {s["name"] for s in said["servers"]} == {*hosts, "ground-endorser"}
    # Who ends while bytes still come to it resets its connection. In flight nobody does. Before, the endorser within
    # agent may: it ends its own stream of blocks when it has caught up with agent's.
    in_flight = {s["name"]: s["first_reset_ns"] for s in said["servers"]
                 if s["resets"] and s["first_reset_ns"] < applied[-1] and (s["name"] != "agent" or s["first_reset_ns"] > applied[0])}
    assert not in_flight, f"commands {applied[0]} to {applied[-1]}"
    assert_nothing_left()


def test_what_does_not_go_together_is_refused(tmp_path):
    def refused(*options) -> str:
        done = subprocess.run([BIN / "ledgerline", "fly", "--out", tmp_path / "run", *options], capture_output=True, text=True,
                              timeout=TIMEOUT_S)
        assert done.returncode in (1, 2), done.stderr
        return done.stdout + done.stderr

    script = tmp_path / "faults.toml"
    script.write_text('[[fault]]\nat_s = 1\ndo = "server agent to loss 5%"\n')
    assert "--proxy" in refused("--faults", str(script))
    assert "no.toml" in refused("--proxy", "--faults", "no.toml")
    said = refused("--proxy", "--faults", str(script), "--storage", "tmpfs")
    assert "loss is of datagrams" in said and "faults.toml:3" in said
    assert_nothing_left()
