"""How soon a stop lands: sixteen drones in the air, each stopped by itself, by four people of three organisations."""
import json
import os
import subprocess

import pytest
from fabric import needs_fabric
from flights import (BIN, assert_nothing_left, control, enroll_operator, fly, no_flight_outlives_its_test, printed, result,
                     wait_for_flight)
from trace_file import TraceKind, records

DRONES = [f"tello{k}" for k in range(1, 17)]
LAND = 3  # FailsafeMode


def stoppers(run) -> list:
    """Configs of operators of the drones' organisation and of two others that are granted the stop."""
    configs = [enroll_operator(run, organisation, user)
               for organisation, user in ((1, "User2"), (2, "User2"), (3, "User1"), (3, "User2"))]
    control(run / "admin.toml", "grant", "--msp", "Org3MSP", "--stop", *DRONES)
    return configs


def quantile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


@pytest.mark.parametrize("ledger", ["embedded", "fabric"] if os.environ.get("LEDGERLINE_LONG") == "1" else ["fabric"])
def test_each_stop_lands_its_drone_while_the_holder_fights(tmp_path, ledger):
    if ledger == "fabric":
        needs_fabric()
    flight = fly(tmp_path, "--drones", str(len(DRONES)), "--seconds", "60", "--ledger", ledger)
    wait_for_flight(tmp_path, flight)
    run = tmp_path / "run"
    who = [word for config in stoppers(run) for word in ("--stopper", config)]
    drones = [word for drone in DRONES for word in ("--drone", drone)]
    done = subprocess.run([BIN / "test_stop_times", *who, *drones, "--holder", run / "operator.toml", "--gap", "0.5"],
                          stdout=subprocess.PIPE, text=True, check=True, timeout=90)
    reported = json.loads(done.stdout)
    assert flight.wait(120) == 1, printed(tmp_path)
    assert result(tmp_path)["why"].count("stopped by") == len(DRONES), result(tmp_path)["why"]
    assert all(stop["attempts"] for stop in reported["stops"]) and reported["fought"] > 0, reported
    modes = [r for r in records(run / "link.trace") if r.kind == TraceKind.MODE and r.extra == LAND]
    lands_ms = []
    for stop in reported["stops"]:
        number = int(stop["drone"].removeprefix("tello"))
        landing = [r.t_ns for r in modes if r.drone == number and r.t_ns > stop["submitted_ns"]]
        assert landing, f"{stop['drone']} was not landed by its stop"
        lands_ms.append((landing[0] - stop["submitted_ns"]) / 1e6)
    first, last = reported["stops"][0]["submitted_ns"], reported["stops"][-1]["submitted_ns"]
    commands = [r for r in records(run / "agent.trace") if r.kind == TraceKind.COMMAND_VERIFIED]
    two_way_ms = lambda of: [(r.t_ns - r.stamp_ns) / 1e6 for r in of]
    figures = {"flight": two_way_ms(commands), "before": two_way_ms(r for r in commands if r.t_ns < first),
               "meanwhile": two_way_ms(r for r in commands if first <= r.t_ns <= last)}
    print(json.dumps({"ledger": ledger, "lands_ms": [round(ms, 1) for ms in lands_ms],
                      "attempts": [stop["attempts"] for stop in reported["stops"]], "fought": reported["fought"],
                      "two_way_ms": {when: {"median": round(quantile(ms, 0.5), 1), "p99": round(quantile(ms, 0.99), 1)}
                                     for when, ms in figures.items()}}))
    agent = json.loads((run / "agent.summary.json").read_text())
    assert agent["integrity_violations"] == 0, (agent["integrity_violations_by_kind"], "a fight over drones among honest peers is no reason to distrust them")
    assert_nothing_left()
