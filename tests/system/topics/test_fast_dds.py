"""A pilot on another implementation of DDS, Fast DDS, on this machine, among sixty participants of others: read and flown by."""
import json
import math
import os
import pathlib
import signal
import subprocess
import sys

import peers
import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, printed
from netns import die_with_parent
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
DOMAIN = 33
CROWD = 60
PORTS = range(7400 + 250 * DOMAIN, 7650 + 250 * DOMAIN)


@pytest.fixture
def crowd():
    program = subprocess.Popen([sys.executable, pathlib.Path(__file__).with_name("crowd.py"), str(DOMAIN), str(CROWD)],
                               stdout=subprocess.PIPE, preexec_fn=die_with_parent)
    assert [program.stdout.readline() for _ in range(CROWD)] == CROWD * [b"there\n"]
    yield
    program.kill()
    program.wait()


def taken_ports() -> int:
    """UDP ports of the domain that somebody has."""
    lines = pathlib.Path("/proc/net/udp").read_text().splitlines()[1:]
    return len({port for line in lines if (port := int(line.split()[1].split(":")[1], 16)) in PORTS})


@pytest.mark.parametrize("release", ["jazzy", "humble"] if LONG else ["jazzy"])
def test_a_pilot_on_fast_dds_reads_and_flies(tmp_path, crowd, release):
    if missing := peers.why_missing("fast-dds"):
        pytest.skip(missing)
    peers.make_lan()  # an interface beside loopback, whose address the pilot announces where the release has it so
    assert taken_ports() >= 2 * CROWD
    flight = fly(tmp_path, "--shape", "manual", "--seconds", "900", "--domains", f"{DOMAIN},{DOMAIN}", "--ros-release", release)
    pilot = peers.Peer([peers.FAST_DDS, release, "tello1", 0.4, 0.5], DOMAIN)
    try:
        pilot.lines_until("landed")
    except AssertionError as why:
        raise AssertionError(f"{why}\n{printed(tmp_path)}") from why
    finally:
        pilot.end()
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    truth = [r[6:9] for r in records(tmp_path / "run" / "sim.trace") if r[1] == TraceKind.TRUTH and r[2] == 1]
    assert max(math.dist(place[:2], truth[0][:2]) for place in truth) > 0.4 and truth[-1][2] < 0.15
    pilot_counts = json.loads((tmp_path / "run" / "ground.summary.json").read_text())["drones"][0]["pilot"]
    assert pilot_counts["velocities"] > 10 and pilot_counts["bad_values"] == pilot_counts["malformed"] == 0, pilot_counts
    assert_nothing_left()
