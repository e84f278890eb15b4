"""scripts/capacity: CPU of each process by drones, drone hosts and channels, and the formula for it."""
import argparse
import collections
import json
import os
import pathlib
import platform
import shutil
import statistics
import sys
import tempfile
import time

from fit import Undetermined, fit, formula
from fleet import Fleet, busy_s, spread, summaries
from running import Failed, cpu_s

EXIT_NOT_MEASURED = 1
# Drones, drone hosts, channels: one at a time around the smallest fleet that can vary them, then the corners.
POINTS = [(1, 1, 1), (4, 1, 1), (16, 1, 1), (4, 2, 1), (4, 3, 1), (4, 1, 2), (4, 1, 4), (16, 3, 1), (16, 1, 4), (16, 3, 4)]
# Two cores carry less of Fabric.
FABRIC_POINTS = [(1, 1, 1), (2, 1, 1), (4, 1, 1), (16, 1, 1), (2, 2, 1), (2, 1, 2), (4, 2, 1), (4, 1, 2)]
QUICK = [(1, 1, 1), (4, 1, 1), (4, 2, 1), (4, 1, 2)]
# What a process's CPU follows, where it is not both.
DRONES_ALONE = ("link", "sim", "roudi")
SATURATED = 0.9  # of the machine's cores: from there on a process gets less than it asks for
FLYING_S, PAUSE_S = 90, 1


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/capacity", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Flies fleets of simulated drones on 1 to 3 drone hosts (network namespaces) and 1 to 4 channels, and\n"
        "measures the CPU of each process in % of a core, with the formula that fits (docs/measuring.md).",
        epilog="Exit codes: 0 all was measured; 1 something was not; 2 bad usage.")
    parser.add_argument("--ledger", choices=("embedded", "fabric"), default="embedded", help="[embedded]")
    parser.add_argument("--seconds", type=float, default=6, help="measured at each point, drones on their path [6]")
    parser.add_argument("--repeat", type=int, default=3, help="each point, every other time in reverse order [3]")
    parser.add_argument("--rate", type=float, default=30, help="states a second of each drone, Hz [30]")
    parser.add_argument("--point", action="append", default=[], metavar="D,H,C", help="drones, drone hosts, channels, in place of those of the ledger; may be given again")
    parser.add_argument("--quick", action="store_true", help="four small points, once: a look, not a result")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE", help="[build/capacity/LEDGER.json]")
    asked = parser.parse_args()
    if asked.repeat < 1 or asked.seconds <= 0 or not 1 <= asked.rate <= 200:
        parser.error("--repeat from 1, --seconds above 0, --rate from 1 to 200")
    asked.points = QUICK if asked.quick else FABRIC_POINTS if asked.ledger == "fabric" else POINTS
    if asked.quick:
        asked.repeat = 1
    if asked.point:
        asked.points = [point_of(parser, text) for text in asked.point]
    asked.json = asked.json or pathlib.Path(__file__).resolve().parents[2] / f"build/capacity/{asked.ledger}.json"
    return asked


def point_of(parser: argparse.ArgumentParser, text: str) -> tuple[int, int, int]:
    try:
        drones, hosts, channels = map(int, text.split(","))
    except ValueError:
        parser.error(f"--point: {text!r} is not drones,hosts,channels, such as 4,2,1")
    if not (1 <= hosts <= 3 and 1 <= channels <= 4 and max(hosts, channels) <= drones <= 16):
        parser.error(f"--point: {text!r}: 1 to 3 hosts, 1 to 4 channels, and up to 16 drones, as many as hosts and channels at least")
    return drones, hosts, channels


def measure(asked: argparse.Namespace, point: tuple[int, int, int], run: pathlib.Path) -> dict:
    """One flight; raises Failed."""
    drones, hosts, channels = point
    programs = pathlib.Path(os.environ["LEDGERLINE_BIN"])
    fabric = pathlib.Path(os.environ["LEDGERLINE_FABRIC"]) if asked.ledger == "fabric" else None
    fleet = Fleet(programs, run, spread(drones, hosts), channels, fabric=fabric, rate_hz=asked.rate)
    try:
        fleet.start()
        flying = fleet.wait_flying(drones, FLYING_S)
        if flying < drones:
            raise Failed(f"{flying} of {drones} drones were on their path after {FLYING_S} s: {fleet.phases()}")
        time.sleep(PAUSE_S)
        all_of_them = fleet.processes()
        begun, busy, before = time.monotonic(), busy_s(), [cpu_s(pid) for _, pid, _, _ in all_of_them]
        time.sleep(asked.seconds)
        took, busy, after = time.monotonic() - begun, busy_s() - busy, [cpu_s(pid) for _, pid, _, _ in all_of_them]
        fleet.check()
        on_path = list(fleet.phases().values()).count("path")
        streams = fleet.streams(fleet.drones)
        agents = list(fleet.agents)
    finally:
        fleet.end()
    states = [drone["states"] for agent in agents for channel in summaries(agent) for drone in channel["drones"]]
    total = lambda key: sum(one[key] for one in states)
    processes = [{"kind": kind, "drones": served, "streams": ways, "cpu_percent": 100 * (b - a) / took}
                 for (kind, _, served, ways), a, b in zip(all_of_them, before, after)]
    return {"drones": drones, "hosts": hosts, "channels": channels, "streams": streams, "seconds": took, "on_path": on_path,
            "machine_percent": 100 * busy / took, "processes": processes,
            "cpu_percent": sum(one["cpu_percent"] for one in processes if one["kind"] != "sim"),
            "states": {key: total(key) for key in ("sampled", "on_ledger", "merged", "dropped", "pending")}}


def saturated(one: dict) -> bool:
    """By whichever is more: what the kernel counts by ticks, or what the processes used."""
    used = max(one["machine_percent"], sum(process["cpu_percent"] for process in one["processes"]))
    return used > 100 * SATURATED * (os.cpu_count() or 1)


def fits(measured: list[dict]) -> dict:
    """Of the whole fleet without its simulators, and of one process of each kind; from the points at which the machine had room."""
    roomy = [one for one in measured if not saturated(one)]
    processes = collections.defaultdict(list)
    for one in roomy:
        for process in one["processes"]:
            processes[process["kind"]].append(process)
    asked = [("fleet", roomy, ("drones", "hosts", "channels"))]
    asked += [(kind, points, ("drones",) if kind in DRONES_ALONE else ("drones", "streams")) for kind, points in processes.items()]
    if not roomy:
        return {"fleet": {"undetermined": "at no point had the machine room"}}
    found = {}
    for name, points, terms in asked:
        try:
            found[name] = fit(points, terms, "cpu_percent")
        except Undetermined as error:
            found[name] = {"undetermined": str(error)}
    return found


def by_kind(one: dict) -> dict[str, float]:
    sums = collections.Counter()
    for process in one["processes"]:
        sums[process["kind"]] += process["cpu_percent"]
    return sums


def table(measured: list[dict]) -> str:
    """A line for each point: the median of its repetitions, of all processes of a kind together, and the spread of the sum."""
    points = collections.defaultdict(list)
    for one in measured:
        points[one["drones"], one["hosts"], one["channels"]].append(one)
    kinds = list(dict.fromkeys(kind for one in measured for kind in by_kind(one)))
    lines = ["CPU in % of a core, all processes of a kind together; all: without sim, (least to most)",
             f"{'drones':>6} {'hosts':>5} {'chan.':>5} " + " ".join(f"{kind:>10}" for kind in kinds) + f" {'all':>22} {'machine':>8} {'merged %':>8}"]
    for (drones, hosts, channels), runs in points.items():
        middle = lambda of: statistics.median(of(one) for one in runs)
        sums = [one["cpu_percent"] for one in runs]
        spread_text = f"{statistics.median(sums):.1f} ({min(sums):.1f} to {max(sums):.1f})"
        merged = middle(lambda one: 100 * one["states"]["merged"] / max(1, one["states"]["sampled"]))
        lines.append(f"{drones:>6} {hosts:>5} {channels:>5} " + " ".join(f"{middle(lambda one, k=kind: by_kind(one)[k]):>10.1f}" for kind in kinds) +
                     f" {spread_text:>22} {middle(lambda one: one['machine_percent']):>8.0f} {merged:>8.1f}" +
                     ("  saturated, not in the formula" if any(map(saturated, runs)) else ""))
    return "\n".join(lines)


def report(found: dict) -> str:
    lines = ["% of a core of the whole fleet without simulators, and of one process of each kind by the drones that it serves and its",
             "streams (one for each drone host on each channel):"]
    return "\n".join(lines + [formula(name, one) if "terms" in one else f"{name:<14}   undetermined: {one['undetermined']}" for name, one in found.items()])


def main() -> int:
    asked = arguments()
    measured, failures = [], []
    place = pathlib.Path(tempfile.mkdtemp(prefix="capacity-"))
    asked.json.parent.mkdir(parents=True, exist_ok=True)
    try:
        for turn in range(asked.repeat):
            for point in asked.points if turn % 2 == 0 else reversed(asked.points):
                run = place / f"{turn}-{'-'.join(map(str, point))}"
                try:
                    one = {"turn": turn, **measure(asked, point, run)}
                except Failed as error:
                    failures.append({"turn": turn, "point": point, "why": str(error)})
                    print(f"{point}: not measured: {error}", file=sys.stderr, flush=True)
                    continue
                measured.append(one)
                print(f"turn {turn + 1}: drones {point[0]}, hosts {point[1]}, channels {point[2]}: {one['cpu_percent']:.1f} %, machine {one['machine_percent']:.0f} %", flush=True)
                shutil.rmtree(run)  # that of one that failed stays until the end
                asked.json.write_text(json.dumps({
                    "asked": {"ledger": asked.ledger, "seconds": asked.seconds, "repeat": asked.repeat, "rate_hz": asked.rate},
                    "machine": {"cores": os.cpu_count(), "system": platform.platform()}, "fits": fits(measured), "failures": failures, "runs": measured}, indent=1) + "\n")
    finally:
        shutil.rmtree(place)
    if measured:
        print("\n" + table(measured) + "\n\n" + report(fits(measured)) + f"\n\n{asked.json}")
    return EXIT_NOT_MEASURED if failures else 0


if __name__ == "__main__":
    sys.exit(main())
