"""What a flight's traces (common/rt/trace.hpp) say for figures: latencies, paths, speeds."""
import json
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "python"))
from trace_file import TraceKind, whole_records

RECORD = np.dtype([("t", "<i8"), ("kind", "<u2"), ("drone", "<u2"), ("extra", "<u4"), ("id", "<u8"), ("stamp", "<i8"),
                   ("v", "<f8", 4)])
POINTS = 600          # of a path or a profile, at most: for the eye
SPEED_WINDOW_S = 0.1  # true speeds are differences over this long


def read(directory: pathlib.Path) -> np.ndarray:
    """All programs' records together; a torn last record (a killed writer) is left out."""
    parts = [np.frombuffer(whole_records(file), RECORD) for file in sorted(directory.glob("*.trace"))]
    return np.concatenate(parts) if parts else np.empty(0, RECORD)


def of_kind(records: np.ndarray, kind: int, drone: int | None = None) -> np.ndarray:
    chosen = records[records["kind"] == kind]
    return chosen if drone is None else chosen[chosen["drone"] == drone]


def latencies_ms(records: np.ndarray, kind: int) -> np.ndarray:
    """From each record's stamp to itself, the first of each plan of each drone alone."""
    chosen = of_kind(records, kind)
    chosen = chosen[np.argsort(chosen["t"], kind="stable")]
    _, first = np.unique(np.stack([chosen["drone"].astype(np.uint64), chosen["id"]]), axis=1, return_index=True)
    return (chosen["t"] - chosen["stamp"])[first] * 1e-6


def paths(directory: pathlib.Path) -> dict[str, dict]:
    """Of each drone: between which moments it was on its path (`between`, ns), and where that begins (`origin`, m), as the one
    who flew it says in its summary."""
    found = {}
    for file in sorted(directory.glob("*.summary.json")):
        try:
            drones = json.loads(file.read_text()).get("drones", [])
        except (ValueError, AttributeError):
            continue
        for drone in drones if isinstance(drones, list) else []:
            if isinstance(drone, dict) and len(drone.get("path_ns") or []) == 2 and drone["path_ns"][1] > 0:
                found[drone["name"]] = {"between": tuple(drone["path_ns"]), "origin": drone["origin"],
                                        "number": int(drone["name"].removeprefix("tello")), "lap_s": drone.get("lap_s", [])}
    return found


def thin(points: np.ndarray) -> np.ndarray:
    return points[::max(1, -(-len(points) // POINTS))]


def positions(records: np.ndarray, drone: int, between) -> np.ndarray:
    """True ones, x and y in metres."""
    truth = of_kind(records, TraceKind.TRUTH, drone)
    truth = truth[(truth["t"] >= between[0]) & (truth["t"] < between[1])]
    return truth[np.argsort(truth["t"], kind="stable")]["v"][:, :2]


def track(records: np.ndarray, drone: int, between: tuple[int, int]) -> list:
    """True positions on the path, for the eye."""
    return np.round(thin(positions(records, drone, between)), 3).tolist()


def corners(shape: str, side_m: float, origin) -> np.ndarray | None:
    """Of the paths of fly (ground/core/path.hpp), closed; None: not one of polylines."""
    unit = {"square": [(0, 0), (1, 0), (1, 1), (0, 1)], "triangle": [(0, 0), (1, 0), (0.5, 3**0.5 / 2)],
            "x": [(0, 0), (1, 1), (1, 0), (0, 1)]}.get(shape)
    return None if unit is None else np.array(unit + unit[:1]) * side_m + np.asarray(origin)


def cross_track(points, path: np.ndarray) -> dict:
    """Distances to the nearest point of the whole path, metres."""
    p = np.asarray(points, float)[:, None, :]
    begin, along = path[:-1][None], np.diff(path, axis=0)[None]
    share = np.clip(((p - begin) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    off = np.linalg.norm(p - begin - share[..., None] * along, axis=-1).min(axis=1)
    return {"rms": float(np.sqrt((off**2).mean())), "max": float(off.max())}


def true_speeds(records: np.ndarray, drone: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, ns, and horizontal speeds, m/s."""
    truth = of_kind(records, TraceKind.TRUTH, drone)
    if len(truth) <= 2:
        return np.empty(0), np.empty(0)
    t = truth["t"] * 1e-9
    half = max(1, int(SPEED_WINDOW_S / 2 / max(1e-3, np.median(np.diff(t)))))
    moved = np.hypot(*(truth["v"][2 * half:, :2] - truth["v"][:-2 * half, :2]).T)
    return truth["t"][half:-half], moved / np.maximum(t[2 * half:] - t[:-2 * half], 1e-3)


def lap_peaks(records: np.ndarray, path: dict | None) -> list[float]:
    """The greatest speed of each finished lap."""
    if path is None:
        return []
    times, speeds = true_speeds(records, path["number"])
    ends = path["between"][0] + 1e9 * np.cumsum([0.0, *path["lap_s"]])
    return [float(speeds[(times >= a) & (times < b)].max(initial=0)) for a, b in zip(ends, ends[1:])]


def profile(records: np.ndarray, drone: int, between: tuple[int, int]) -> dict:
    """Horizontal speeds over time: the drone's true one; the setpoint that was flown; and the virtual one, what the
    controller said of the state of that moment, however much later the drone got to hear it."""
    begin, end = between
    grid = np.linspace(begin, end, min(POINTS, max(2, int((end - begin) * 20e-9))))
    speeds = {"t_s": np.round((grid - begin) * 1e-9, 2).tolist()}

    def add(name: str, times: np.ndarray, values: np.ndarray) -> None:
        if len(times) > 1:
            order = np.argsort(times, kind="stable")
            speeds[name] = np.round(np.interp(grid, times[order], values[order]), 3).tolist()

    add("true", *true_speeds(records, drone))
    for name, kind, when in (("flown", TraceKind.COMMAND_APPLIED, "t"), ("virtual", TraceKind.COMMAND_MADE, "stamp")):
        chosen = of_kind(records, kind, drone)
        add(name, chosen[when], np.hypot(chosen["v"][:, 0], chosen["v"][:, 1]))
    return speeds
