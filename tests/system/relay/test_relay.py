"""Flights of the real processes on an embedded node that lies: it has the key of the drones' own peer, runs the contract honestly, and
signs other results (tests/system/relay/lying_node.cpp). Nothing is flown that nobody signed, and the drone comes down."""
import os

import pytest
from flights import fly, no_flight_outlives_its_test, printed
from lying import Flown, lying_programs

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
# Flights in real time: of each kind of transaction one, the others with --long. All fly in simulated time (relay_test).
LIES = ["plan-added", "frame-flies"] + (["plan-speed", "command-acquire", "frame-cut"] if LONG else [])


@pytest.mark.parametrize("lie", LIES)
def test_nothing_is_flown_that_nobody_signed(lying_programs, monkeypatch, lie):
    out = lying_programs / "flight"
    monkeypatch.setenv("LYING_LIE", lie)
    monkeypatch.setenv("LYING_AFTER_S", "12")  # by then it flies
    flight = fly(out, "--gateway", "--laps", "3", "--side", "1.5")
    flight.wait(180)
    flown = Flown(lying_programs)
    lies, wrong = flown.lies, flown.unsigned()
    print(f"{lie}: {lies['tampered']} results tampered with, {lies['submitted']} signed and submitted, {len(flown.applied)} plans flown, "
          f"{len(wrong)} of them asked for by nobody, highest {max(r.v2 for r in flown.truth):.2f} m")
    assert lies["tampered"] > 0 and len(flown.applied) > 20, printed(out)
    assert wrong == []
    assert not flown.cuts(), "motors were cut"
    assert lies["submitted"] == 0, "a client signed what it had not asked for"
    assert flown.truth[-1].v2 < 0.1, "it is still in the air"
