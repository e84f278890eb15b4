"""Flights of the real processes whose agent is served blocks by a peer that lies (hil/sitl/ledger): it has the real key of
the drones' own peer and no orderer's. In mid flight the operator says stop, behind the lie; some agents are killed there and
start again. Nothing is flown that nobody signed, or in another order; the stop lands the drone no later than the failsafe's
silence would; and somebody says that there is a lie."""
import json
import os
import re
import signal
import subprocess
import time

import pytest
from flights import control, fly, no_flight_outlives_its_test, pid_of, printed, result, wait_for_flight
from lying import Flown, lying_programs
from trace_file import TraceKind

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
LAND = 3  # FailsafeMode
PLAN_RAN_OUT, LEDGER_SILENT, STOPPED = 1, 4, 10  # FailsafeCause
SILENT_AFTER_S, HOLD_GRACE_S, LAND_AFTER_S = 1.0, 0.1, 5.0  # onboard/agent/core/agent_core.hpp, onboard/link/core/settings.hpp
BUSY_S = 0.5  # of a machine that does other things as well
LANDING_S = 6.0  # from 3 m

# What stays away or comes late contradicts nothing.
SILENT = ["withholds", "withholds-stops", "withholds-commands", "delays", "stutters", "grows-old"]
BENT = ["hides-commands", "hides-stops", "hides-stops-as-double", "hides-controls", "hides-all", "hides-some", "trusts-own",
        "no-flags", "bends-plan", "bends-and-hashes", "loses-block-signatures", "swaps-block-signatures", "names-other-config",
        "mixes-headers", "signs-bent-plan", "signs-broken-creator", "signs-without-endorsement", "signs-outsiders-endorsement",
        "signs-other-channel", "signs-own-stop", "signs-own-command", "signs-left-out", "signs-reordered", "signs-replayed",
        "signs-empty", "signs-config", "skips", "repeats", "renumbers", "turns-away", "forks", "forks-unsigned", "garbage",
        "mixes"]
KILLED = ["hides-stops", "hides-all", "names-other-config", "signs-config", "signs-replayed", "renumbers", "forks", "grows-old",
          "withholds", "mixes"]
SHORT = [("hides-stops", "killed"), ("trusts-own", ""), ("forks", ""), ("withholds-stops", "")]
FLIGHTS = [(lie, "") for lie in BENT + SILENT] + [(lie, "killed") for lie in KILLED] if LONG else SHORT


def grant(run) -> None:
    control(run / "admin.toml", "grant", "--msp", "Org3MSP", "--stop", "tello1")


def fly_behind(lie: str, killed: str, folder, seed: int) -> int:
    """When the operator said stop."""
    out = folder / "flight"
    flight = fly(out, "--gateway", "--laps", "30", "--side", "1.5")
    wait_for_flight(out, flight)
    grant(out / "run")
    time.sleep(0.3 * (seed % 5))
    os.kill(pid_of("lying_node"), signal.SIGUSR1)
    if lie == "hides-controls":
        grant(out / "run")
    time.sleep(1 + 0.2 * (seed % 4))
    if killed:
        os.kill(pid_of("ledgerline-agent"), signal.SIGKILL)
        time.sleep(1.5)
    stop_ns = time.monotonic_ns()
    control(out / "run" / "operator.toml", "stop", "tello1")
    try:
        flight.wait(SILENT_AFTER_S + LAND_AFTER_S + LANDING_S + 15)
    except subprocess.TimeoutExpired:  # its ground may never hear that the drone is down
        flight.send_signal(signal.SIGINT)
        flight.wait(60)
    return stop_ns


def without_stop(applied: list, modes: list) -> list:
    """The ledger's stop itself comes as a plan of agent's, numbered behind what that agent has seen; link takes it as it lands."""
    stops = {r.t_ns for r in modes if r.extra == LAND and int(r.v0) == STOPPED}
    return [r for r in applied if r.t_ns not in stops]


def alarms(run) -> dict[str, int]:
    """By kind: of all lives by the log, of the last one by its summary."""
    kinds = {}
    for log in run.glob("agent*.log"):
        for kind in re.findall(r"the ledger is not trusted, (\w+)", log.read_text(errors="replace")):
            kinds[kind] = kinds.get(kind, 0) + 1
    summary = run / "agent.summary.json"
    return kinds | (json.loads(summary.read_text())["integrity_violations_by_kind"] if summary.exists() else {})


@pytest.mark.parametrize("lie, killed", FLIGHTS)
def test_a_tampered_stream_flies_nothing_and_hides_no_stop(lying_programs, monkeypatch, lie, killed):
    seed = FLIGHTS.index((lie, killed)) + 1
    out = lying_programs / "flight"
    monkeypatch.setenv("LYING_BLOCKS", lie)
    monkeypatch.setenv("LYING_SEED", str(seed))
    stop_ns = fly_behind(lie, killed, lying_programs, seed)
    flown = Flown(lying_programs)
    blocks, violations = flown.lies["blocks"], alarms(out / "run")
    modes = [r for r in flown.link if r.kind == TraceKind.MODE and r.t_ns > blocks["began_ns"]]
    wrong = without_stop(flown.unsigned(), modes)
    held_for = {int(r.v0) for r in modes if r.extra != 0}
    landing_s = [(r.t_ns - stop_ns) / 1e9 for r in modes if r.extra == LAND]
    in_air = [r.t_ns for r in flown.truth if r.v2 > 0.1]
    down_s = (in_air[-1] - stop_ns) / 1e9
    print(json.dumps({"lie": lie, "killed": bool(killed), "served": blocks["served"], "tampered": blocks["tampered"],
                      "ordered": blocks["ordered"], "flown": len(flown.applied), "unsigned": len(wrong), "alarms": violations,
                      "causes": sorted(held_for), "lands_s": landing_s and round(landing_s[0], 2), "down_s": round(down_s, 2),
                      "restarts": result(out)["restarts"]}))
    assert blocks["began_ns"] > 0 and len(flown.applied) > 20, printed(out)
    assert wrong == []
    for life in flown.lives:
        order = [r.id for r in without_stop(life, modes) if r.kind == TraceKind.COMMAND_APPLIED and r.id != 0]
        assert order == sorted(order), "flown in another order"
    assert not [r for r in modes if int(r.v0) == STOPPED and r.t_ns < stop_ns], "landed by a stop of nobody's"
    assert not flown.cuts(), "motors were cut"
    assert flown.truth[-1].v2 < 0.1, "it is still in the air"
    assert landing_s and landing_s[0] < SILENT_AFTER_S + HOLD_GRACE_S + LAND_AFTER_S + BUSY_S, "the stop was hidden"
    assert down_s < SILENT_AFTER_S + HOLD_GRACE_S + LAND_AFTER_S + LANDING_S + BUSY_S
    if lie in SILENT:
        assert violations or held_for & {PLAN_RAN_OUT, LEDGER_SILENT}, "nobody says so"
    else:
        assert blocks["tampered"] > 0 and violations, "nobody says so"
    if killed:
        assert result(out)["restarts"]["agent"] >= 1
