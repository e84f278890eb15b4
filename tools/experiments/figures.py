"""Figures of an experiment's JSON, as PNG: what was published in light grey, ours in colour."""
import pathlib
import re
import textwrap

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import config
import traces
import verdicts

PAGE = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", config.STYLE.split("@media")[0]))  # the pages' light colours
OURS = (PAGE["two-way"], PAGE["age"], PAGE["good"], "#8e44ad", PAGE["bad"], "#0f8b8d")
GREY = WANTED = PAGE["published"]
MAX_TRACKS = 16
OVERVIEW = {"latency": "Two-way latency beside the published boxes", "delay": "Speed growing every lap, square of 12 m"}
plt.rcParams.update({"font.size": 9, "axes.grid": True, "grid.color": PAGE["grid"], "text.color": PAGE["ink"], "axes.labelcolor": PAGE["ink"], "axes.axisbelow": True, "figure.dpi": 100,
                     "axes.spines.top": False, "axes.spines.right": False})


def colour(i: int) -> str:
    return OURS[i % len(OURS)]


def chosen(document: dict, figure: dict) -> dict[str, list[dict]]:
    names = figure["cases"] or document["cases"]
    return {name: document["cases"][name] for name in names if document["cases"].get(name)}


def seconds(stats: dict) -> dict:
    return {"whislo": stats["low"], "q1": stats["q1"], "med": stats["median"], "q3": stats["q3"], "whishi": stats["high"],
            "fliers": []}


def pooled(repetitions: list[dict], name: str = "two_way_ms") -> list[float]:
    """Every repetition weighs the same: each is as many quantiles."""
    return [value for one in repetitions for value in one.get(name) or []]


def draw_boxes(axes, document: dict, cases: dict, published: dict) -> None:
    labels, at = [], 0
    for i, (name, repetitions) in enumerate(cases.items()):
        box = repetitions[0].get("published")
        drawn = [(published["box"][box], GREY, "published")] if box else []
        samples = pooled(repetitions)
        if samples:
            drawn.append(({key: 1e-3 * value for key, value in verdicts.box(samples).items()}, colour(i), "ours"))
        for stats, shade, whose in drawn:
            axes.bxp([seconds(stats)], positions=[at], widths=0.7, patch_artist=True, showfliers=False,
                     boxprops={"facecolor": shade + "55", "edgecolor": shade}, medianprops={"color": shade, "linewidth": 2},
                     whiskerprops={"color": shade}, capprops={"color": shade})
            axes.annotate(f"{1e3 * stats['median']:.0f} ms", (at, stats["high"]), textcoords="offset points", xytext=(0, 4),
                          ha="center", fontsize=8, color=shade)
            labels.append((at, f"{textwrap.fill(name, 14)}\n{whose}"))
            at += 1
        at += 0.5
    axes.set_xticks([at for at, _ in labels], [label for _, label in labels], fontsize=7)
    axes.set_yscale("log")
    axes.set_ylabel("two-way latency, s")


def boxes(document: dict, figure: dict, published: dict):
    cases = chosen(document, figure)
    fig, axes = plt.subplots(figsize=(max(6, 1.9 * len(cases)), 4))
    draw_boxes(axes, document, cases, published)
    return fig


def trajectories(document: dict, figure: dict, _published: dict):
    cases = chosen(document, figure)
    columns = min(4, len(cases))
    rows = -(-len(cases) // columns)
    fig, all_axes = plt.subplots(rows, columns, figsize=(3.4 * columns, 3.4 * rows), squeeze=False)
    for axes in all_axes.flat[len(cases):]:
        axes.axis("off")
    for axes, (name, repetitions) in zip(all_axes.flat, cases.items()):
        for i, track in enumerate(list(repetitions[0].get("tracks", {}).values())[:MAX_TRACKS]):
            if not track["flown"]:
                continue
            points = np.array(track["flown"])
            options = document["asked"]["cases"][name]
            path = traces.corners(options.get("shape", "square"), options.get("side", 1.5), track["origin"])
            if path is not None:
                axes.plot(*path.T, "--", color=WANTED, linewidth=1)
            axes.plot(*points.T, color=colour(i), linewidth=1.2)
        axes.set_aspect("equal", "datalim")
        axes.set_title(name)
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
    return fig


def velocities(document: dict, figure: dict, _published: dict):
    cases = {name: all for name, all in chosen(document, figure).items() if all[0].get("profile")}
    fig, all_axes = plt.subplots(max(1, len(cases)), 1, figsize=(8, 2.6 * max(1, len(cases))), squeeze=False)
    for axes, (name, repetitions) in zip(all_axes.flat, cases.items()):
        profile = repetitions[0]["profile"]
        for key, label, shade, style in (("virtual", "virtual (of that moment's state)", GREY, "-"),
                                         ("flown", "setpoint flown", OURS[1], "-"), ("true", "drone", OURS[0], "-")):
            if key in profile:
                axes.plot(profile["t_s"], profile[key], style, color=shade, label=label, linewidth=1.1)
        axes.set_title(name)
        axes.set_ylabel("speed, m/s")
        axes.legend(loc="upper right", fontsize=7)
    all_axes.flat[-1].set_xlabel("s on the path")
    return fig


def draw_ramp(axes, cases: dict) -> None:
    for i, (name, repetitions) in enumerate(cases.items()):
        for k, one in enumerate(repetitions):
            axes.plot([turn["speed_mps"] for turn in one["turns"]], [turn["max_m"] for turn in one["turns"]], "o-",
                      markersize=3, linewidth=1, alpha=0.8, color=colour(i), label=name if k == 0 else None)
    for bound, text in ((verdicts.GOOD_BELOW_M, "good below"), (verdicts.FAILS_BEYOND_M, "failed above")):
        axes.axhline(bound, color=GREY, linestyle="--", linewidth=1)
        axes.annotate(text, (0, bound), xycoords=("axes fraction", "data"), textcoords="offset points", xytext=(2, 2),
                      fontsize=7, color=GREY)
    axes.set_yscale("log")
    axes.set_xlabel("speed asked for the lap, m/s")
    axes.set_ylabel("largest error of the lap, m")
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2)


def ramp(document: dict, figure: dict, _published: dict):
    """Error of each turn over its speed, every repetition; the bounds of good and failed."""
    fig, axes = plt.subplots(figsize=(7, 4))
    draw_ramp(axes, {name: all for name, all in chosen(document, figure).items() if any(one["turns"] for one in all)})
    return fig


def exchange(document: dict, figure: dict, published: dict):
    """Medians with the quartiles, and CPU, over the rate."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4))
    series = {}
    for repetitions in chosen(document, figure).values():
        for one in repetitions:
            for name, samples in one["exchange_ms"].items():
                client, rate = name.rsplit(".", 1)
                cpu = one["figures"].get(name + ".cpu_percent")
                series.setdefault(client, {}).setdefault(int(rate), []).append((samples, cpu))
    for i, (client, rates) in enumerate(sorted(series.items())):
        at = sorted(rates)
        box = [np.quantile([value for samples, _ in rates[rate] for value in samples], [0.25, 0.5, 0.75]) for rate in at]
        median = np.array([b[1] for b in box])
        left.errorbar(at, median, [median - [b[0] for b in box], [b[2] for b in box] - median], color=colour(i), marker="o",
                      capsize=3, label=client)
        cpu = [(rate, np.median([c for _, c in rates[rate] if c is not None])) for rate in at
               if any(c is not None for _, c in rates[rate])]
        if cpu:
            right.plot(*zip(*cpu), "o-", color=colour(i), label=client)
    there = [one for one in published["exchange"] if "latency" in one]
    left.plot([one["messages_per_s"] for one in there], [1e3 * one["latency"] for one in there], "s", color=GREY,
              label="published")
    for axes, label in ((left, "latency, ms (median and quartiles)"), (right, "CPU of both clients, % of a core")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("msg/s, both directions together")
        axes.set_ylabel(label)
        axes.legend(fontsize=7)
    return fig


def values_of(repetitions: list[dict], name: str) -> list[float]:
    return [one["figures"][name] for one in repetitions if name in one["figures"]]


def bars(document: dict, figure: dict, _published: dict):
    """One figure of each case: median, and lowest to highest."""
    cases = {name: values_of(all, figure["figure"]) for name, all in chosen(document, figure).items()}
    cases = {name: values for name, values in cases.items() if values}
    fig, axes = plt.subplots(figsize=(7, 0.8 + 0.36 * len(cases)))
    for i, values in enumerate(cases.values()):
        middle = float(np.median(values))
        axes.barh(i, middle, color=OURS[0] + "99", height=0.65)
        axes.errorbar(middle, i, xerr=[[middle - min(values)], [max(values) - middle]], color=PAGE["ink"], capsize=3)
        axes.annotate(f"{middle:.3g}", (max(values), i), textcoords="offset points", xytext=(5, -3), fontsize=8)
    axes.set_yticks(range(len(cases)), cases)
    axes.invert_yaxis()
    axes.set_xlabel(figure["label"])
    if figure["log"]:
        axes.set_xscale("log")
    return fig


def lines(document: dict, figure: dict, published: dict):
    """One figure over one option that is a number, a line for each value of others: medians, lowest to highest as a band;
    or means. `where`: of cases with these options alone. `beside`: what others have published, over the same."""
    fig, axes = plt.subplots(figsize=(7, 4))
    series = {}
    by = figure["by"].split(", ") if figure["by"] else []
    for name, repetitions in chosen(document, figure).items():
        options = document["asked"]["cases"][name]
        values = values_of(repetitions, figure["figure"])
        wanted = all(options.get(key) == value for key, value in figure["where"].items())
        if wanted and values and isinstance(options.get(figure["x"]), (int, float)) and all(key in options for key in by):
            label = ", ".join(f"{key.replace('_', ' ')} {options[key]}" for key in by)
            series.setdefault(label, []).append((options[figure["x"]], values))
    for i, (label, points) in enumerate(series.items()):
        points.sort(key=lambda one: one[0])
        x = [x for x, _ in points]
        wider = 1.2 * (len(series) - 1 - i)  # a line that lies on another one leaves an edge of it
        axes.plot(x, [np.mean(v) if figure["mean"] else np.median(v) for _, v in points], "o-", color=colour(i), label=label or None,
                  linewidth=1.5 + wider, markersize=6 + wider)
        if not figure["mean"]:
            axes.fill_between(x, [min(v) for _, v in points], [max(v) for _, v in points], color=colour(i), alpha=0.15)
    for marker, name in zip("sD^", figure["beside"]):
        other = published["over_delay"][name]
        axes.plot(other["delay"], other[figure["figure"]], marker + "--", color=GREY, linewidth=1, label=other["what"])
    axes.set_xlabel(figure["x"].replace("_", " "))
    axes.set_ylabel(figure["label"])
    if figure["log"]:
        axes.set_yscale("log")
    if by or figure["beside"]:
        axes.legend(fontsize=7)
    return fig


DRAW = {"boxes": boxes, "trajectories": trajectories, "velocities": velocities, "ramp": ramp, "exchange": exchange,
        "bars": bars, "lines": lines}


def save(fig, file: pathlib.Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    fig.tight_layout()
    fig.savefig(file)
    plt.close(fig)


def draw(document: dict, published: dict, directory: pathlib.Path) -> list[tuple[str, pathlib.Path]]:
    """All of an experiment's figures that there is something for: (title, file)."""
    drawn = []
    for i, figure in enumerate(document["figures_asked"], 1):
        if not chosen(document, figure):
            continue
        file = directory / f"{document['experiment']}-{i}.png"
        save(DRAW[figure["kind"]](document, figure, published), file)
        drawn.append((figure["title"], file))
    return drawn


def overview(documents: dict[str, dict], published: dict, file: pathlib.Path) -> bool:
    """One picture: latencies beside the published boxes, and ramps under the published delay. False: there is neither."""
    drawn = []
    for name, draw_it in (("latency", lambda axes, document, cases: draw_boxes(axes, document, cases, published)),
                          ("delay", lambda axes, _document, cases: draw_ramp(axes, cases))):
        cases = {case: all for case, all in documents.get(name, {"cases": {}})["cases"].items()
                 if all and "published settings" not in case and (name != "delay" or case.startswith("ramp"))}
        if cases:
            drawn.append((documents[name], cases, draw_it))
    if not drawn:
        return False
    fig, all_axes = plt.subplots(1, len(drawn), figsize=(6.4 * len(drawn), 3.6), squeeze=False)
    for axes, (document, cases, draw_it) in zip(all_axes.flat, drawn):
        draw_it(axes, document, cases)
        where = "simulated time" if document["asked"]["runs"] == "sitl" else f"{document['asked']['ledger']} ledger"
        axes.set_title(f"{OVERVIEW[document['experiment']]} ({where})", fontsize=9)
    save(fig, file)
    return True
