"""Boxes, spreads and verdicts: pure functions of figures."""
import itertools
import math

import numpy as np

GOOD_BELOW_M = 0.4    # the top speed is the largest one of a ramp with a maximum error below this
FAILS_BEYOND_M = 1.0  # "fails": an error above this, or a lap unfinished
OF_ALL_LAPS = ("rms_m", "max_m", "lap_s")  # how these figures' names end
QUANTILE_POINTS = 201  # a distribution is kept as so many quantiles, evenly spaced


def distribution(samples) -> list[float]:
    """Quantiles 0, 0.5 %, ... 100 %: small, and whole enough for boxes and pooling."""
    if len(samples) == 0:
        return []
    return np.round(np.quantile(np.asarray(samples, float), np.linspace(0, 1, QUANTILE_POINTS)), 4).tolist()


def box(values) -> dict:
    """Quartiles and median; whiskers at the farthest value within 1.5 times the box from it (Tukey), as box plots have it."""
    values = np.sort(np.asarray(values, float))
    q1, median, q3 = np.quantile(values, [0.25, 0.5, 0.75])
    reach = 1.5 * (q3 - q1)
    return {"low": float(values[values >= q1 - reach][0]), "q1": float(q1), "median": float(median), "q3": float(q3),
            "high": float(values[values <= q3 + reach][-1])}


def spread(values) -> dict | None:
    """Of one figure over its repetitions."""
    values = [value for value in values if value is not None and math.isfinite(value)]
    if not values:
        return None
    return {"median": float(np.median(values)), "low": float(min(values)), "high": float(max(values)),
            "mean": float(np.mean(values)), "deviation": float(np.std(values, ddof=1)) if len(values) > 1 else None,
            "count": len(values)}


def good_turns(turns: list[dict], limit_m: float = GOOD_BELOW_M) -> list[dict]:
    """Of a ramp: the laps up to the first one that was not finished or had an error that is not below the limit."""
    return list(itertools.takewhile(lambda turn: turn["finished"] and turn["max_m"] < limit_m, turns))


def ramp_figures(turns: list[dict], asked: list[float], finished: bool, full_scale_mps: float) -> tuple[dict, str]:
    """Of the laps before the first bad one (`asked`: the speeds of all laps that were wanted): the fastest as it was asked for,
    the greatest mean speed over a lap, which corners and the controller's own limit slow down, and the greatest speed at
    all; 0: none was good. And what ended it: the lap that failed, or that the drone cannot be commanded more, or only the ramp."""
    good = good_turns(turns)
    figures = {f"top_{name}": max((turn[key] for turn in good), default=0.0)
               for name, key in (("speed_mps", "speed_mps"), ("lap_mps", "flown_mps"), ("peak_mps", "peak_mps"))}
    if len(good) < len(asked) and (len(good) < len(turns) or not finished):
        figures["failed_at_mps"] = asked[len(good)]
        return figures, f"failed at {asked[len(good)]:.3g} m/s"
    figures["unfailed_to_mps"] = asked[-1]
    own = f"the drone cannot be commanded faster than {full_scale_mps:.3g} m/s" if asked[-1] >= full_scale_mps else "the ramp ended there"
    return figures, f"nothing failed up to {asked[-1]:.3g} m/s: {own}"


def later_figures(laps: list[dict], first: int = 3) -> dict:
    """From the `first`-th lap on, when the model has been learned."""
    later = [lap for lap in laps[first - 1:] if lap["finished"]]
    if not later:
        return {}
    seconds = sum(lap["seconds"] for lap in later)
    return {"later_rms_m": math.sqrt(sum(lap["rms_m"]**2 * lap["seconds"] for lap in later) / seconds),
            "later_lap_s": seconds / len(later)}


def failed(repetition: dict) -> bool:
    return repetition["figures"].get("finished") == 0.0


def measured(repetition: dict, figure: str) -> float | None:
    """Errors and laps are of a flight that was finished: a part of one says nothing of the rest."""
    return None if failed(repetition) and figure.endswith(OF_ALL_LAPS) else repetition["figures"].get(figure)


def margins(bar: dict, cases: dict[str, list[dict]], boxes: dict) -> list[tuple[str, int, float]]:
    """For each case and repetition the value that the bar bounds: (case, seed, value). Of a flight that failed before there
    was one, or that its figure is of the whole of, it is infinitely bad."""
    found = []
    for name in bar["cases"]:
        for repetition in cases.get(name, []):
            figures, seed = repetition["figures"], repetition["seed"]
            if bar["rule"] == "times_below_published":
                box_there = boxes[repetition["published"]]
                ours = [figures.get(f"two_way_ms.{q}") for q in ("q1", "median", "q3")]
                if all(ours):
                    found.append((name, seed, min(1e3 * box_there[q] / own
                                                  for q, own in zip(("q1", "median", "q3"), ours))))
                elif failed(repetition):
                    found.append((name, seed, 0.0))
                continue
            value = measured(repetition, bar["figure"])
            if value is None and failed(repetition):
                found.append((name, seed, math.inf if bar["rule"] == "at_most" else -math.inf))
                continue
            if bar["against"]:
                other = [measured(one, bar["figure"]) for one in cases.get(bar["against"], []) if one["seed"] == seed]
                value = value / other[0] if value is not None and other and other[0] else None
            if value is not None:
                found.append((name, seed, float(value)))
    return found


def pooled_note(bar: dict, cases: dict[str, list[dict]]) -> str:
    """Beside the worst seed, all of them as if they were one: of errors the root of the mean square, else the mean."""
    if not bar["against"] or len(bar["cases"]) != 1:
        return ""
    square = "rms" in bar["figure"]
    means = []
    for name in (bar["cases"][0], bar["against"]):
        values = [measured(one, bar["figure"]) for one in cases.get(name, [])]
        if not values or None in values:
            return ""
        means.append(math.sqrt(np.mean(np.square(values))) if square else float(np.mean(values)))
    return f"; all seeds together: {means[0] / means[1]:.3g}" if means[1] else ""


def unfailed_note(bar: dict, cases: dict[str, list[dict]]) -> str:
    """That a top speed is none: in which cases nothing failed, and up to which speed."""
    if not (bar.get("figure") or "").startswith("top_"):
        return ""
    names = [*bar["cases"], *([bar["against"]] if bar["against"] else [])]
    ends = {name: [one["figures"].get("unfailed_to_mps") for one in cases.get(name, [])] for name in names}
    said = [f"{name}: at least, nothing failed up to {values[0]:.3g} m/s" for name, values in ends.items()
            if values and None not in values]
    return "; " + "; ".join(said) if said else ""


def verdict(bar: dict, cases: dict[str, list[dict]], boxes: dict, ledger: str) -> dict:
    """`kept` or `missed` over every repetition, the worst one decides; `not measured` where one is missing or the bar is for
    another ledger; cases that were not asked for (a quick look) do not count. Fewer seeds than the bar asks for are said."""
    out = {"what": bar["what"], "limit": bar.get("limit", bar.get("factor")), "rule": bar["rule"], "note": ""}
    values = margins(bar, cases, boxes)
    out["values"] = spread([value for _, _, value in values])
    if bar["ledger"] not in (None, ledger):
        return {**out, "verdict": "not measured", "note": f"the bar is for {bar['ledger']}, this was on {ledger}"}
    asked = [name for name in bar["cases"] if name in cases]
    measured = {name for name, _, _ in values}
    missing = [name for name in asked if name not in measured] if asked else bar["cases"]
    if missing:
        return {**out, "verdict": "not measured", "note": "nothing of " + "; ".join(missing)}
    above = bar["rule"] != "at_most"
    worst = (min if above else max)(values, key=lambda one: one[2])
    kept = worst[2] >= out["limit"] if above else worst[2] <= out["limit"]
    seeds = min(len([1 for name, _, _ in values if name == case]) for case in asked)
    out["note"] = f"worst: {worst[2]:.3g} ({worst[0]}, seed {worst[1]})" if math.isfinite(worst[2]) else (
        f"{worst[0]}, seed {worst[1]}: the flight failed")
    out["note"] += pooled_note(bar, cases) + unfailed_note(bar, cases)
    if len(asked) < len(bar["cases"]):
        out["note"] += f"; {len(asked)} of {len(bar['cases'])} cases"
    if seeds < bar["seeds"]:
        out["note"] += f"; {seeds} of the {bar['seeds']} repetitions that the bar asks for"
    return {**out, "verdict": "kept" if kept else "missed"}
