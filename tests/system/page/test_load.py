"""What onlookers cost the flight of sixteen drones: ten pairs of some seconds of the same flight, with and without them, in turns."""
import json
import os
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import time

import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, pid_of, printed, wait_for_flight
from running import cpu_s
from station import Station
from test_page import HERE, NPM
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
DRONES, CLIENTS, PAIRS = 16, 10, 10
SETTLE_S, WINDOW_S = 3, 7
MAX_RATIO = 1.2
MAX_MORE_CPU = 0.25  # of a core, of ground

# At the lowest priority, as on another computer: what they cost the server is measured, not what they cost themselves.
LOOK_ON = """
import os, sys, threading
from websockets.sync.client import connect
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
url, token, count = sys.argv[1:]
def look():
    with connect(url, subprotocols=["ledgerline.v1", f"token.{token}"], source_address=(f"127.0.0.{2 + i // 5}", 0)) as stream:
        for _ in stream: pass
for i in range(int(count)): threading.Thread(target=look, args=(i,), daemon=True).start()
print("open", flush=True)
sys.stdin.read()
os._exit(0)
"""


def yield_as_groups(name: str) -> None:
    """A browser is a session of its own, and the kernel shares the processor between sessions first (sched_autogroup)."""
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            if (process / "comm").read_text().startswith(name):
                (process / "autogroup").write_text("19")
        except (FileNotFoundError, ProcessLookupError):  # it has ended, or the kernel has no such groups
            continue


class Onlookers:
    """Ten clients, and a browser that has the processor's time that others leave (`idle`), or its share as any other program."""

    def __init__(self, station: Station, browser: str) -> None:
        clients = [sys.executable, "-c", LOOK_ON, f"{station.url.replace('http', 'ws', 1)}/api/v1/stream", station.token, str(CLIENTS)]
        commands = [clients]
        if browser != "none":
            commands.append([*(["chrt", "--idle", "0"] if browser == "idle" else []), "node", HERE / "onlooker.mjs", f"{station.url}/#token={station.token}"])
        self.all = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, "LEDGERLINE_PAGE_NPM": str(NPM)})
                    for command in commands]
        assert all(one.stdout.readline() == "open\n" for one in self.all)
        if browser == "idle":
            yield_as_groups("chrom")

    def close(self) -> str:
        """What the browser's page says of its pictures."""
        said = [one.communicate(timeout=60)[0] for one in self.all]
        assert all(one.returncode == 0 for one in self.all)
        return said[-1].strip()


def interval(values: list[float]) -> tuple[float, float]:
    """Of the median, 95 %, by drawing again."""
    draw = random.Random(1)
    medians = sorted(statistics.median(draw.choices(values, k=len(values))) for _ in range(4000))
    return medians[100], medians[3899]


@pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1, on a quiet machine: four minutes each")
@pytest.mark.parametrize("browser", ["none", "idle", "normal"])
def test_onlookers_take_no_commands_time(tmp_path, browser):
    flight = fly(tmp_path, "--drones", str(DRONES), "--seconds", str(2 * PAIRS * (SETTLE_S + WINDOW_S + 6)), "--watch")
    station = Station(tmp_path, flight)
    wait_for_flight(tmp_path, flight)
    ground = pid_of("ledgerline-ground")
    windows = []
    pictures = []
    for pair in range(PAIRS):
        for beside in ((False, True) if pair % 2 else (True, False)):
            onlookers = Onlookers(station, browser) if beside else None
            time.sleep(SETTLE_S)
            begin_ns, used_s = time.monotonic_ns(), cpu_s(ground)
            time.sleep(WINDOW_S)
            windows.append((pair, beside, begin_ns, time.monotonic_ns(), (cpu_s(ground) - used_s) / WINDOW_S))
            if onlookers:
                pictures.append(onlookers.close())
    flight.send_signal(signal.SIGINT)
    assert flight.wait(120) == 1, printed(tmp_path)  # it was asked to land before its path ended, and says so
    two_way = [(r.t_ns, (r.t_ns - r.stamp_ns) / 1e6) for r in records(tmp_path / "run" / "agent.trace") if r.kind == TraceKind.COMMAND_VERIFIED]
    p99_ms, cpu = {}, {}
    for pair, beside, begin_ns, end_ns, used in windows:
        took = sorted(ms for t_ns, ms in two_way if begin_ns < t_ns < end_ns)
        assert len(took) > 0.8 * DRONES * 10 * WINDOW_S, "commands came"
        p99_ms[pair, beside], cpu[pair, beside] = took[int(0.99 * (len(took) - 1))], used
    ratios = [p99_ms[pair, True] / p99_ms[pair, False] for pair in range(PAIRS)]
    more_cpu = [cpu[pair, True] - cpu[pair, False] for pair in range(PAIRS)]
    low, high = interval(ratios)
    print(json.dumps({"browser": browser, "ratio": round(statistics.median(ratios), 3), "interval": [round(low, 3), round(high, 3)],
                      "p99_ms_without": [round(p99_ms[pair, False], 1) for pair in range(PAIRS)],
                      "p99_ms_with": [round(p99_ms[pair, True], 1) for pair in range(PAIRS)],
                      "cpu_without": [round(cpu[pair, False], 3) for pair in range(PAIRS)], "more_cpu": [round(more, 3) for more in more_cpu],
                      "pictures_a_second": pictures}))
    assert max(more_cpu) < MAX_MORE_CPU
    if browser != "normal":  # a browser that draws on the flight's own two cores takes what it takes: the figure is printed
        assert high < MAX_RATIO
    assert_nothing_left()
