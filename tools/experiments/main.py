"""ledgerline experiment: the published experiments and those beyond, repeated with seeds; JSON, figures, one page."""
import dataclasses
import os
import pathlib
import signal
import sys
import time

import asked as command_line
import config
import runs
import store
import verdicts

EXIT_NOT_MEASURED, EXIT_USAGE = 1, 2


def say(text: str) -> None:
    print(text, flush=True)


def short(result: dict) -> str:
    """One repetition in a few words."""
    figures = result["figures"]
    words = []
    for name, unit, factor in (("two_way_ms.median", "ms two-way", 1), ("rms_m", "cm rms", 100), ("max_m", "cm max", 100),
                               ("top_speed_mps", "m/s top speed", 1)):
        if name in figures:
            words.append(f"{factor * figures[name]:.3g} {unit}")
    words += [f"{name[:-10]}: {value:.3g} ms" for name, value in figures.items() if name.endswith(".ms.median")]
    if result.get("ramp_end"):
        words.append(result["ramp_end"])
    if figures.get("finished") == 0.0:
        words.append(f"not finished: {result['why']}")
    return ", ".join(words)


def measure(experiment: config.Experiment, place: runs.Place, out: pathlib.Path, seeds: int | None) -> dict:
    """All repetitions, those kept from before included; the experiment's JSON is rewritten after each."""
    started = time.monotonic()
    boxes = config.read_published()["box"]
    programs = runs.digest(place, experiment.runs)
    chosen = [case for case in experiment.cases if case.on in (None, place.ledger)]
    cases = {case.name: [] for case in chosen}
    not_measured = []
    document = {"format": store.FORMAT, "experiment": experiment.name, "number": experiment.number, "title": experiment.title,
                "question": experiment.question, "notes": experiment.notes, "figures_asked": experiment.figures,
                "asked": {"runs": experiment.runs, "ledger": place.ledger, "storage": place.storage, "quick": experiment.quick,
                          "seeds": seeds or experiment.seeds,
                          "cases": {case.name: case.options for case in chosen}},
                "left_out": {case.name: f"only on {case.on}" for case in experiment.cases if case not in chosen},
                "programs": programs, "machine": store.machine(), "cases": cases, "not_measured": not_measured}

    def write() -> None:
        document["spread"] = {name: spreads(repetitions) for name, repetitions in cases.items()}
        document["bars"] = [verdicts.verdict(bar, cases, boxes, place.ledger) for bar in experiment.bars]
        document["seconds"] = round(time.monotonic() - started, 1)
        store.write(out / f"{experiment.name}.json", document)

    # Seed by seed, all cases in turn: what changes on the machine meanwhile changes for all of them.
    for seed in range(1, (seeds or experiment.seeds) + 1):
        for case in chosen:
            file = store.repetition_file(out, experiment.name, case.name, seed)
            asked = {"runs": experiment.runs, "options": case.options, "published": case.published, "seed": seed,
                     "ledger": place.ledger, "storage": place.storage, "programs": programs}
            found = store.kept(file, asked)
            began = time.monotonic()
            if found is None:
                try:
                    found = {"asked": asked, "seed": seed, "published": case.published,
                             **runs.repetition(experiment.runs, case, place, seed)}
                    found["seconds"] = round(time.monotonic() - began, 1)
                    if incomplete := found.pop("incomplete", ""):
                        not_measured.append({"case": case.name, "seed": seed, "why": incomplete})
                        say(f"  {case.name}, seed {seed}: {incomplete}")
                    else:
                        store.write(file, found)
                except runs.NotMeasured as error:
                    not_measured.append({"case": case.name, "seed": seed, "why": str(error)})
                    say(f"  {case.name}, seed {seed}: not measured: {error}")
                    write()
                    continue
                how = f"{found['seconds']:.0f} s"
            else:
                how = "kept from before"
            cases[case.name].append(found)
            say(f"  {case.name}, seed {seed}: {short(found)} ({how})")
            write()
    write()
    return document


def spreads(repetitions: list[dict]) -> dict:
    names = dict.fromkeys(name for one in repetitions for name in one["figures"])
    return {name: verdicts.spread([one["figures"].get(name) for one in repetitions]) for name in names}


def interrupted(*_) -> None:
    raise KeyboardInterrupt


def main() -> int:
    try:
        experiments = config.read_all()
        asked = command_line.arguments(experiments)
        chosen = [one for one in config.read_all(asked.quick) if asked.name in (one.name, "all")]
        if asked.case:
            chosen = [dataclasses.replace(one, cases=[case for case in one.cases if case.name in asked.case]) for one in chosen]
    except config.ConfigError as error:
        print(f"experiment: {error}", file=sys.stderr)
        return EXIT_USAGE
    signal.signal(signal.SIGTERM, interrupted)
    bin_directory = pathlib.Path(os.environ["LEDGERLINE_BIN"])
    build = command_line.root() / "build"
    place = runs.Place(bin_directory, pathlib.Path(os.environ.get("LEDGERLINE_NPM", build / "npm")),
                       pathlib.Path(os.environ.get("LEDGERLINE_FABRIC", build / "fabric")), asked.out / "running",
                       asked.ledger, asked.storage)
    all_measured, times = True, []
    try:
        for experiment in chosen:
            say(f"{experiment.number}. {experiment.name}: {experiment.title}")
            began = time.monotonic()
            document = measure(experiment, place, asked.out, asked.seeds)
            times.append((experiment.name, time.monotonic() - began))
            all_measured = all_measured and not document["not_measured"]
            for bar in document["bars"]:
                say(f"  {bar['verdict']}: {bar['what']} ({bar['note']})")
    except KeyboardInterrupt:
        say("interrupted: what is finished is kept, the same command goes on from there")
        all_measured = False
    import report  # matplotlib takes its time
    page = report.write(asked.out)
    for name, seconds in times:
        say(f"{name:<12} {seconds:6.0f} s")
    say(f"{'all':<12} {sum(seconds for _, seconds in times):6.0f} s")
    say(f"page: {page}")
    return 0 if all_measured else EXIT_NOT_MEASURED


if __name__ == "__main__":
    sys.exit(main())
