"""One repetition of one case, on the programs themselves: a flight, a simulated flight, an exchange of messages, three hosts."""
import contextlib
import ctypes
import dataclasses
import hashlib
import json
import pathlib
import shutil
import signal
import subprocess
import tempfile

import hosts as three_hosts
import traces
import verdicts
from config import SETTINGS, Case

HERE = pathlib.Path(__file__).resolve().parent
TIMEOUT_S = 900     # beyond what was asked: only how long something broken may take
LANDING_S = 60       # that an interrupted run gets to land and end
PR_SET_PDEATHSIG = 1
DAEMONS = ("agent", "bridge", "chaincode", "endorser", "ground", "link", "node", "roudi", "sim")
# Below bin/ and libexec/ledgerline/.
PROGRAMS = {"flight": ["fly", "link", "agent", "ground", "sim", "node", "ledger", "chaincode", "tools", "roudi", "control"],
            "sitl": ["fault"], "exchange": ["tools", "node", "ledger", "chaincode", "fault"],
            "hosts": ["link", "agent", "ground", "sim", "node", "fault", "roudi", "control"]}
SOURCES = {"exchange": [HERE.parent / "bench/node/client.cjs"], "hosts": [HERE / "hosts.py", HERE.parent / "python/netns.py", HERE.parent / "python/running.py"]}
STATE_HZ = {70: 30, 110: 50}  # states a second of the published rates, messages a second
FULL_SCALE_MPS = 1.0                # what a drone can be commanded at most, where nothing else is asked for: rc 100
MAX_DELAY_MS = 3000       # of hil sitl
SITL_LEDGER_MS = 17        # two-way latency of hil sitl without a delay added
libc = ctypes.CDLL(None, use_errno=True)


class NotMeasured(Exception):
    """Why there are no figures: something could not be run. What ran and went wrong is a figure: it failed."""


@dataclasses.dataclass(frozen=True)
class Place:
    programs: pathlib.Path  # bin/
    npm: pathlib.Path
    fabric: pathlib.Path
    work: pathlib.Path      # for the run's files, which are removed when its figures are taken
    ledger: str             # embedded or fabric
    storage: str            # of the ledger where a case does not say: disk or tmpfs

    def program(self, name: str) -> list:
        """The words that start a daemon, or a verb of `ledgerline`."""
        words = [self.programs / f"ledgerline-{name}"] if name in DAEMONS else [self.programs / "ledgerline", name]
        if not words[0].exists():
            raise NotMeasured(f"{words[0].name} is not built: ninja -C build/release programs")
        return words


def digest(place: Place, runs: str) -> str:
    """Of the programs that a repetition ran and what takes its figures: those of others are not taken for theirs."""
    sources = [HERE / name for name in ("runs.py", "traces.py", "verdicts.py")] + [HERE.parent / "python/trace_file.py"] + SOURCES.get(runs, [])
    total = hashlib.sha256(b"".join(source.read_bytes() for source in sources))
    for name in PROGRAMS[runs]:
        folder = place.programs if name in DAEMONS else place.programs.parent / "libexec/ledgerline"
        path = folder / f"ledgerline-{name}"
        if path.exists():
            total.update(name.encode() + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


def words(options: dict) -> list[str]:
    """As options of a program: true is a flag alone, false is none."""
    found = []
    for name, value in options.items():
        if value is False:
            continue
        found.append("--" + name.replace("_", "-"))
        if value is not True:
            found.append(",".join(map(str, value)) if isinstance(value, list) else str(value))
    return found


def run_program(command: list, log: pathlib.Path, limit_s: float) -> tuple[int | None, str]:
    """To its end; its exit code (None: it did not end in time) and what it wrote to stdout. An interrupt reaches it as one, and it may land its drones."""
    with open(log, "wb") as errors:
        process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=errors, text=True,
                                   start_new_session=True,
                                   preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, signal.SIGINT))
    try:
        out, _ = process.communicate(timeout=limit_s)
        return process.returncode, out
    except subprocess.TimeoutExpired:
        return None, ""
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.communicate(timeout=LANDING_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


def tail(log: pathlib.Path, lines: int = 5) -> str:
    with contextlib.suppress(OSError):
        return "\n".join(log.read_text(errors="replace").strip().splitlines()[-lines:])
    return ""


def ending(program: str, code: int | None, log: pathlib.Path) -> str:
    how = "did not end in time" if code is None else f"ended with {code}"
    return f"{program} {how}: {tail(log)}"


def quantile_figures(name: str, samples) -> dict:
    points = verdicts.distribution(samples)
    if not points:
        return {}
    at = lambda share: points[round(share * (len(points) - 1))]
    return {f"{name}.{key}": at(share) for key, share in
            (("q1", 0.25), ("median", 0.5), ("q3", 0.75), ("p95", 0.95), ("p99", 0.99), ("max", 1.0))}


def tracking_figures(drones: list[dict], finished: bool) -> dict:
    """Of the worst drone. Who came down before the end of its first lap has an error of next to no path: none."""
    errors = [drone["cross_track_m"] for drone in drones if drone.get("cross_track_m") and drone["lap_s"]]
    laps = [lap for drone in drones for lap in drone["lap_s"]]
    figures = {"finished": 1.0 if finished else 0.0}
    if errors:
        figures.update(rms_m=max(error["rms"] for error in errors), max_m=max(error["max"] for error in errors))
    if laps:
        figures["lap_s"] = sum(laps) / len(laps)
    figures["fails"] = 0.0 if finished and errors and figures["max_m"] <= verdicts.FAILS_BEYOND_M else 1.0
    figures["completed"] = 1.0 - figures["fails"]
    return figures


def flight_laps(drone: dict, peaks: list[float]) -> list[dict]:
    """Those that were finished."""
    return [{"speed_mps": turn["asked_mps"], "flown_mps": turn["flown_mps"], "peak_mps": peak, "seconds": seconds,
             "rms_m": turn["rms_m"], "max_m": turn["max_m"], "finished": True}
            for turn, seconds, peak in zip(drone["turns"], drone["lap_s"], peaks)]


def sitl_laps(drone: dict) -> list[dict]:
    return [{"speed_mps": lap["asked_mps"], "flown_mps": lap["flown_mps"], "peak_mps": lap["peak_mps"],
             "seconds": lap["seconds"], "rms_m": lap["rms_m"], "max_m": lap["max_m"], "finished": lap["seconds"] > 0}
            for lap in drone["laps"]]


def own_limit(drone: dict) -> dict:
    """The controller's own limit of speed at the end, and how far it slowed down in between; nothing where it did not."""
    return {name: drone[name] for name in ("limit_mps", "slowed_to_mps") if drone.get(name) is not None}


def asked_speeds(options: dict) -> list[float]:
    """Of a ramp's laps."""
    start, step = map(float, options["ramp"].split(":"))
    return [start + step * i for i in range(options["laps"])]


def lap_figures(laps: list[dict], options: dict, finished: bool) -> dict:
    """`figures`, and of a ramp what ended it (`ramp_end`)."""
    figures = verdicts.later_figures(laps)
    if "ramp" not in options:
        return {"figures": figures}
    more, end = verdicts.ramp_figures(laps, asked_speeds(options), finished, options.get("full_scale", FULL_SCALE_MPS))
    return {"figures": figures | more, "ramp_end": end}


def failed(why: str, options: dict) -> dict:
    """A flight that did not get so far as to have figures of its own."""
    laps = lap_figures([], options, finished=False)
    return {**laps, "figures": tracking_figures([], False) | laps["figures"], "why": why, "turns": []}


def flight_options(case: Case, place: Place, seed: int) -> dict:
    options = dict(case.options)
    ledger = options.pop("ledger", place.ledger)
    settings = SETTINGS[options.pop("settings", "ours")]
    if ledger != "none":
        options = {**settings, "storage": place.storage, **options}
    if ledger != "fabric":
        options.pop("orderers", None)
        if ledger == "none" and options.get("gateway"):
            raise NotMeasured("--gateway needs a ledger")
    return {**options, "ledger": ledger, "seed": seed}


def flown(records, paths: dict) -> dict:
    """What is in the traces of a flight, no matter who started it."""
    two_way, age = (traces.latencies_ms(records, kind) for kind in (traces.TraceKind.COMMAND_VERIFIED, traces.TraceKind.COMMAND_APPLIED))
    return {"figures": {**quantile_figures("two_way_ms", two_way), **quantile_figures("age_ms", age)},
            "two_way_ms": verdicts.distribution(two_way), "age_ms": verdicts.distribution(age),
            "tracks": {name: {"origin": path["origin"], "flown": traces.track(records, path["number"], path["between"])}
                       for name, path in paths.items()},
            "profile": traces.profile(records, 1, paths["tello1"]["between"]) if "tello1" in paths else {}}


def flight(case: Case, place: Place, seed: int) -> dict:
    options = flight_options(case, place, seed)
    run, result, log = place.work / "run", place.work / "result.json", place.work / "fly.log"
    command = [*place.program("fly"), "--out", run, "--json", result, *words(options)]
    code, _ = run_program(command, log, TIMEOUT_S + options.get("seconds", 0))
    if code in (1, 2) and not result.exists():
        raise NotMeasured(f"fly {' '.join(words(options))}: {tail(log)}")
    if code is None or not result.exists():
        return failed(ending("fly", code, log), options)
    out = json.loads(result.read_text())
    records = traces.read(run)
    paths = traces.paths(run)
    if not paths:
        return failed(out.get("why") or "no drone got onto its path", options)
    seen = flown(records, paths)
    first = out["drones"][0]
    laps = flight_laps(first, traces.lap_peaks(records, paths.get(first["id"])))
    finished = code == 0 and out["ok"]
    of_laps = lap_figures(laps, options, finished)
    figures = {**seen["figures"], **tracking_figures(out["drones"], finished),
               **{name: out[name] for name in ("messages_per_s", "transactions_per_s") if name in out},
               **{f"cpu_percent.{name}": value for name, value in out["cpu_percent"].items()},
               "cpu_percent.all": sum(out["cpu_percent"].values()), **of_laps["figures"], **own_limit(first)}
    return {**seen, **of_laps, "figures": figures, "why": out.get("why", ""), "ledger": out["ledger"], "turns": laps}


def sitl(case: Case, place: Place, seed: int) -> dict:
    log = place.work / "hil.log"
    options = {**case.options, "seed": seed}
    code, printed = run_program([*place.program("hil"), "sitl", *words(options)], log, TIMEOUT_S)
    if code == 2:
        raise NotMeasured(f"hil sitl {' '.join(words(options))}: {tail(log)}")
    try:
        out = json.loads(printed)
    except ValueError:
        return failed(ending("hil sitl", code, log), options)
    laps = sitl_laps(out["drones"][0])
    of_laps = lap_figures(laps, options, code == 0)
    figures = {**tracking_figures(out["drones"], code == 0), **of_laps["figures"]}
    for name in ("two_way_ms", "age_ms"):
        worst = max((drone[name] for drone in out["drones"] if drone[name]["count"]), key=lambda q: q["median"], default={})
        figures.update({f"{name}.{key}": value for key, value in worst.items()})
    if out["blocks"]:
        figures["commands_per_block"] = sum(drone["commands"]["sent"] for drone in out["drones"]) / out["blocks"]
    figures.update(own_limit(out["drones"][0]))
    return {**of_laps, "figures": figures, "why": out["why"], "turns": laps, "times_real_time": out["times_real_time"],
            "digest": out["digest"]}


def exchange(case: Case, place: Place, seed: int) -> dict:
    result, log = place.work / "exchange.json", place.work / "bench.log"
    options = {"ledger": place.ledger, **case.options}
    ramp = {name: options.pop(name) for name in ("ramp", "laps")}
    ours = [client for client in options["clients"] if client.startswith("ledgerline")]
    missing = ""
    if shutil.which("node") is None or not (place.npm / "node_modules/@hyperledger/fabric-gateway").is_dir():
        missing = "without Node.js and its packages (./run-tests installs them) the baselines are not measured"
        options["clients"] = ours
    # Each repetition is one alternation: every other one in reverse order.
    if seed % 2 == 0:
        options["clients"] = options["clients"][::-1]
    options |= {"alternations": 1, "npm": place.npm, "fabric": place.fabric, "json": result}
    with tempfile.TemporaryDirectory(prefix="ledgerline-experiment-",
                                     dir="/dev/shm" if place.storage == "tmpfs" else place.work) as ledgers:
        code, _ = run_program([*place.program("bench"), "two-way", "--dir", ledgers, *words(options)], log, 2 * TIMEOUT_S)
    if code != 0 or not result.exists():
        raise NotMeasured(ending("bench two-way", code, log))
    out = json.loads(result.read_text())
    there = {(one["client"], one["rate"]) for one in out["runs"]}
    if lacking := [f"{client} at {rate}" for client in options["clients"] for rate in options["rates"]
                   if (client, rate) not in there]:
        raise NotMeasured(f"bench two-way says nothing of {', '.join(lacking)}")
    figures, samples = {}, {}
    for one in out["runs"]:
        name = f"{one['client']}.{one['rate']}"
        times = one["latencies_ms"]
        if not times and not one["collapsed"]:
            raise NotMeasured(f"bench two-way: no answer came to {one['client']} at {one['rate']}, and it did not collapse")
        figures.update(quantile_figures(name + ".ms", times))
        figures[name + ".lost_percent"] = 100 * one["lost"] / max(1, one["sent"])
        figures[name + ".collapsed"] = float(one["collapsed"])
        if one["cpu_ms_per_message"] is not None and not one["collapsed"]:
            # Of one core: each message and each answer costs that.
            figures[name + ".cpu_percent"] = one["cpu_ms_per_message"] * one["rate"] / 10
        samples[name] = verdicts.distribution(times)
        if one["rate"] in STATE_HZ and not one["collapsed"] and figures[name + ".ms.median"] < MAX_DELAY_MS:
            figures[name + ".top_speed_mps"] = plain_top_speed(place, seed, one["rate"], figures[name + ".ms.median"], ramp)
    return {"figures": figures, "why": missing, "incomplete": missing, "ledger": out["ledger"], "exchange_ms": samples}


def plain_top_speed(place: Place, seed: int, rate: int, median_ms: float, ramp: dict) -> float:
    """What a controller without prediction, as the published one, reaches with this latency, in simulated time."""
    delay_s = round(max(0.0, median_ms - SITL_LEDGER_MS) * 1e-3, 4)
    options = {**ramp, "predict": "off", "rate": STATE_HZ[rate], "delay": delay_s}
    return sitl(Case("top speed", options), place, seed)["figures"]["top_speed_mps"]


def hosts(case: Case, place: Place, seed: int) -> dict:
    if place.ledger != "embedded":
        raise NotMeasured("three hosts are flown on the embedded ledger alone")
    run = place.work / "run"
    try:
        finished = three_hosts.fly(place.program, run, case.options, seed, TIMEOUT_S)
    except three_hosts.Failed as error:
        return failed(f"three hosts: {error}", case.options)
    except (RuntimeError, subprocess.SubprocessError, OSError) as error:
        raise NotMeasured(f"three hosts: {error}") from None
    records, paths = traces.read(run), traces.paths(run)
    if "tello1" not in paths:
        return failed("three hosts: the drone did not get onto its path", case.options)
    out = flown(records, paths)
    error = traces.cross_track(out["tracks"]["tello1"]["flown"],
                               traces.corners(case.options["shape"], three_hosts.SIDE_M, paths["tello1"]["origin"]))
    figures = out["figures"] | tracking_figures([{"cross_track_m": error, "lap_s": paths["tello1"]["lap_s"]}], finished)
    return {**out, "figures": figures, "why": "" if finished else "the path was not finished", "turns": []}


RUN = {"flight": flight, "sitl": sitl, "exchange": exchange, "hosts": hosts}


def repetition(runs: str, case: Case, place: Place, seed: int) -> dict:
    """Its figures; raises NotMeasured. The run's files are gone afterwards, but not those of one that was not measured."""
    shutil.rmtree(place.work, ignore_errors=True)
    place.work.mkdir(parents=True)
    try:
        out = RUN[runs](case, place, seed)
    except KeyboardInterrupt:
        shutil.rmtree(place.work)
        raise
    shutil.rmtree(place.work)
    return out
