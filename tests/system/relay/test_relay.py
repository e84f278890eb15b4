"""Flights of the real processes on an embedded node that lies: it has the key of the drones' own peer, runs the contract honestly, and
signs other results (tests/system/relay/lying_node.cpp). Nothing is flown that nobody signed, and the drone comes down."""
import json
import os
import pathlib

import pytest
from flights import fly, no_flight_outlives_its_test, printed
from trace_file import TraceKind, records

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
CUT = 4  # FailsafeMode
LIES = ["plan-speed", "plan-added", "command-acquire", "frame-cut", "frame-flies"]


@pytest.fixture
def lying_programs(tmp_path, monkeypatch):
    """The programs of this build, with one that lies in the node's place."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for program in BIN.iterdir():
        if program.name != "ledgerline-node":
            (programs / program.name).symlink_to(program)
    (programs / "ledgerline-node").symlink_to(BIN / "lying_node")
    monkeypatch.setenv("LEDGERLINE_BIN", str(programs))
    monkeypatch.setenv("LYING_NODE", str(BIN / "ledgerline-node"))
    monkeypatch.setenv("LYING_LOG", str(tmp_path / "lies.json"))
    monkeypatch.setenv("LYING_AFTER_S", "12")  # by then it flies
    return tmp_path


def unsigned(applied: list[tuple], lies: dict) -> list[tuple]:
    """Plans that link flew, and that nobody asked for, or that a bent event told: by number and their state's stamp."""
    asked = {tuple(plan) for plan in lies["asked"]}
    told = {tuple(plan) for plan in lies["told"]}
    return [r for r in applied if (r[4], r[5]) not in asked or (r[4], r[5]) in told]


@pytest.mark.parametrize("lie", LIES)
def test_nothing_is_flown_that_nobody_signed(lying_programs, monkeypatch, lie):
    out = lying_programs / "flight"
    monkeypatch.setenv("LYING_LIE", lie)
    flight = fly(out, "--laps", "3", "--side", "1.5")
    flight.wait(180)
    lies = json.loads((lying_programs / "lies.json").read_text())
    link = [r for trace in (out / "run").glob("link*.trace") for r in records(trace)]
    applied = [r for r in link if r[1] == TraceKind.COMMAND_APPLIED and r[4] != 0]
    wrong = unsigned(applied, lies)
    truth = [r for r in records(out / "run" / "sim.trace") if r[1] == TraceKind.TRUTH]
    print(f"{lie}: {lies['bent']} results bent, {lies['submitted']} signed and submitted, {len(applied)} plans flown, "
          f"{len(wrong)} of them asked for by nobody, highest {max(r[8] for r in truth):.2f} m")
    assert lies["bent"] > 0 and len(applied) > 20, printed(out)
    assert wrong == []
    assert not [r for r in link if r[1] == TraceKind.MODE and r[3] == CUT], "motors were cut"
    assert lies["submitted"] == 0, "a client signed what it had not asked for"
    assert truth[-1][8] < 0.1, "it is still in the air"
