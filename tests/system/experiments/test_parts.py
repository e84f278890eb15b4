"""What the experiments' figures and verdicts are made of: statistics, configs, what is kept of an interrupted one."""
import json
import re
import subprocess

import config
import main
import pytest
import runs
import store
import traces
import verdicts
from conftest import ROOT
from trace_file import HEADER, MAGIC, RECORD, TraceKind

EMPTY_TRACE = HEADER.pack(MAGIC, RECORD.size)

BOXES = {"square": {"q1": 0.396, "median": 0.456, "q3": 0.525}}


def repetition(seed: int, published: str | None = None, **figures) -> dict:
    return {"seed": seed, "published": published,
            "figures": {name.replace("__", "."): value for name, value in figures.items()}}


def bar(rule: str, cases: list, **more) -> dict:
    return {"what": "a bar", "rule": rule, "cases": cases, "against": None, "ledger": None, "seeds": 2, **more}


def test_a_box_has_quartiles_and_whiskers_within_one_and_a_half_boxes():
    box = verdicts.box([-100, 2, 3, 4, 5, 6, 7, 8, 9, 100])
    assert (box["q1"], box["median"], box["q3"]) == (3.25, 5.5, 7.75)
    assert (box["low"], box["high"]) == (2, 9), "the farthest value within 1.5 x 4.5 of the box"


def test_a_distribution_is_kept_whole_enough():
    points = verdicts.distribution(range(1001))
    assert len(points) == verdicts.QUANTILE_POINTS and (points[0], points[100], points[-1]) == (0, 500, 1000)
    assert verdicts.distribution([]) == []


def test_a_spread_leaves_out_what_is_no_number():
    assert verdicts.spread([3, None, 1, float("nan"), 2]) == {
        "median": 2, "low": 1, "high": 3, "mean": 2, "deviation": 1, "count": 3}
    assert verdicts.spread([None]) is None


def lap(speed: float, error: float, finished: bool = True, flown: float = 0.0, seconds: float = 10.0, rms: float = 0.1,
        peak: float = 0.0) -> dict:
    return {"speed_mps": speed, "max_m": error, "finished": finished, "flown_mps": flown, "peak_mps": peak, "seconds": seconds,
            "rms_m": rms}


def test_the_top_speed_is_that_of_the_last_good_lap_and_what_ended_the_ramp_is_reported():
    asked = [0.5, 1.0, 1.5, 2.0]
    laps = [lap(0.5, 0.1, flown=0.45, peak=0.6), lap(1.0, 0.39, flown=0.8, peak=1.1), lap(1.5, 0.4, flown=1.2, peak=1.6),
            lap(2.0, 0.1, flown=1.5, peak=2.1)]
    good = {"top_speed_mps": 1.0, "top_lap_mps": 0.8, "top_peak_mps": 1.1}
    assert verdicts.ramp_figures(laps, asked, True, 2.0) == (good | {"failed_at_mps": 1.5}, "failed at 1.5 m/s")
    assert verdicts.ramp_figures(laps[:2], asked, False, 2.0) == (good | {"failed_at_mps": 1.5}, "failed at 1.5 m/s"), \
        "the third lap was begun and never finished"
    for reported, why in ((1.0, "the drone cannot be commanded faster than 1 m/s"), (2.0, "the ramp ended there")):
        assert verdicts.ramp_figures(laps[:2], asked[:2], True, reported) == (
            good | {"unfailed_to_mps": 1.0}, f"nothing failed up to 1 m/s: {why}")
    assert verdicts.ramp_figures([], asked, False, 2.0)[0] == {
        "top_speed_mps": 0, "top_lap_mps": 0, "top_peak_mps": 0, "failed_at_mps": 0.5}


def test_a_top_speed_that_nothing_bounded_is_reported_as_none():
    of = bar("at_least", ["far"], figure="top_speed_mps", against="near", limit=0.8)
    cases = {"far": [repetition(1, top_speed_mps=4.0, unfailed_to_mps=4.0), repetition(2, top_speed_mps=3.0, failed_at_mps=3.5)],
             "near": [repetition(1, top_speed_mps=4.0, unfailed_to_mps=4.0), repetition(2, top_speed_mps=3.0, unfailed_to_mps=4.0)]}
    note = verdicts.verdict(of, cases, BOXES, "embedded")["note"]
    assert "near: at least, nothing failed up to 4 m/s" in note and "far: at least" not in note


def test_a_flight_that_failed_before_it_had_a_figure_misses_its_bar():
    for rule, against in (("at_most", None), ("at_least", None), ("at_most", "local")):
        of = bar(rule, ["square"], figure="rms_m", limit=1 if rule == "at_most" else 0, against=against)
        cases = {"square": [repetition(1, rms_m=0.1, finished=1.0), repetition(2, finished=0.0)],
                 "local": [repetition(seed, rms_m=0.1) for seed in (1, 2)]}
        found = verdicts.verdict(of, cases, BOXES, "embedded")
        assert found["verdict"] == "missed" and "square, seed 2: the flight failed" in found["note"]
        json.dumps(found, allow_nan=False)
    boxed = bar("times_below_published", ["square"], factor=15)
    assert verdicts.verdict(boxed, {"square": [repetition(1, "square", finished=0.0)]}, BOXES, "embedded")["verdict"] == "missed"


@pytest.mark.parametrize("figure", ["rms_m", "max_m", "lap_s", "later_rms_m"])
def test_a_part_of_a_flight_that_failed_keeps_no_bar_and_is_none_to_be_measured_against(figure):
    whole, part = {figure: 0.2, "finished": 1.0}, {figure: 0.1, "finished": 0.0}
    alone = verdicts.verdict(bar("at_most", ["far"], figure=figure, limit=9), {"far": [repetition(1, **part)]}, BOXES, "embedded")
    assert alone["verdict"] == "missed" and "far, seed 1: the flight failed" in alone["note"]
    of = bar("at_most", ["far"], figure=figure, against="near", limit=9)
    against = lambda far, near: verdicts.verdict(of, {"far": [repetition(1, **far)], "near": [repetition(1, **near)]}, BOXES, "embedded")
    assert against(whole, whole)["verdict"] == "kept" and against(part, whole)["verdict"] == "missed"
    assert against(whole, part)["verdict"] == "not measured"


def test_a_ramp_that_failed_has_its_top_speed_all_the_same():
    of = bar("at_least", ["far"], figure="top_speed_mps", against="near", limit=0.8)
    cases = {name: [repetition(1, top_speed_mps=2.0, finished=0.0)] for name in ("far", "near")}
    assert verdicts.verdict(of, cases, BOXES, "embedded")["verdict"] == "kept"


def test_all_seeds_together_are_reported_beside_the_worst():
    cases = {"far": [repetition(1, rms_m=0.3), repetition(2, rms_m=0.4)], "near": [repetition(1, rms_m=0.3), repetition(2, rms_m=0.1)]}
    note = verdicts.verdict(bar("at_most", ["far"], figure="rms_m", against="near", limit=9), cases, BOXES, "embedded")["note"]
    assert "all seeds together: 1.58" in note, "the root of 0.25 / 0.1"


def test_what_is_learned_is_checked_from_the_third_lap_on():
    laps = [lap(1, 0.1, rms=9.0), lap(1, 0.1, rms=9.0), lap(1, 0.1, rms=0.3, seconds=10), lap(1, 0.1, rms=0.4, seconds=30)]
    figures = verdicts.later_figures(laps)
    assert figures["later_lap_s"] == 20 and figures["later_rms_m"] == pytest.approx(((0.09 * 10 + 0.16 * 30) / 40) ** 0.5)
    assert verdicts.later_figures(laps[:2]) == {}


def test_the_worst_repetition_and_the_worst_quantile_decide():
    cases = {"square": [repetition(1, "square", two_way_ms__q1=20.0, two_way_ms__median=22.0, two_way_ms__q3=24.0),
                        repetition(2, "square", two_way_ms__q1=20.0, two_way_ms__median=30.4, two_way_ms__q3=31.0)]}
    kept = verdicts.verdict(bar("times_below_published", ["square"], factor=15), cases, BOXES, "fabric")
    assert kept["verdict"] == "kept" and kept["values"]["low"] == pytest.approx(456 / 30.4)
    cases["square"][1]["figures"]["two_way_ms.median"] = 30.5
    missed = verdicts.verdict(bar("times_below_published", ["square"], factor=15), cases, BOXES, "fabric")
    assert missed["verdict"] == "missed" and "square, seed 2" in missed["note"]


def test_a_ratio_is_taken_within_a_seed():
    cases = {"predicted": [repetition(1, rms_m=0.2), repetition(2, rms_m=0.13)],
             "local": [repetition(2, rms_m=0.1), repetition(1, rms_m=0.2)]}
    of = bar("at_most", ["predicted"], figure="rms_m", against="local", limit=1.3)
    found = verdicts.verdict(of, cases, BOXES, "embedded")
    assert found["verdict"] == "kept"
    assert found["values"]["high"] == pytest.approx(1.3) and found["values"]["low"] == pytest.approx(1)


def test_what_is_missing_is_no_verdict():
    of = bar("at_least", ["a", "b"], figure="finished", limit=1)
    only_a = {"a": [repetition(1, finished=1.0)], "b": []}
    assert verdicts.verdict(of, only_a, BOXES, "embedded")["verdict"] == "not measured"
    assert "b" in verdicts.verdict(of, only_a, BOXES, "embedded")["note"]
    del only_a["b"]  # it was not asked for
    quick = verdicts.verdict(of, only_a, BOXES, "embedded")
    assert quick["verdict"] == "kept" and "1 of 2 cases" in quick["note"] and "1 of the 2 repetitions" in quick["note"]
    of["ledger"] = "fabric"
    assert verdicts.verdict(of, only_a, BOXES, "embedded")["verdict"] == "not measured"
    assert verdicts.verdict(of, only_a, BOXES, "fabric")["verdict"] == "kept"


def test_published_figures_are_the_same_as_those_of_a_flight():
    text = (ROOT / "tools/report/results.hpp").read_text()
    there = {name: tuple(map(float, values)) for name, *values in
             re.findall(r'PublishedBox\{"([^"]+)", ([.\d]+), ([.\d]+), ([.\d]+), ([.\d]+), ([.\d]+)\}', text)}
    boxes = {"3 drones" if name == "three" else name: tuple(box[key] for key in ("low", "q1", "median", "q3", "high"))
             for name, box in config.read_published()["box"].items()}
    assert boxes == there


def test_every_config_reads_whole_and_quick():
    whole, quick = config.read_all(), config.read_all(quick=True)
    assert [one.number for one in whole] == list(range(1, 13))
    for one, short in zip(whole, quick):
        assert len(short.cases) <= len(one.cases) and short.seeds <= one.seeds and short.bars == one.bars


GOOD = """number = 1
title = "T"
question = "Q"
runs = "flight"
[options]
speed = 0.5
[[case]]
name = "square"
shape = "square"
published = "square"
[quick]
cases = ["square"]
[[bar]]
what = "W"
rule = "at_most"
figure = "rms_m"
limit = 1
[[figure]]
kind = "boxes"
title = "F"
"""


@pytest.mark.parametrize("found, instead, words", [
    ("number = 1", "", "number: is missing"),
    ("number = 1", "number = true", "number: True is no whole number"),
    ('runs = "flight"', 'runs = "walk"', "runs: 'walk' is none of flight, sitl, exchange, hosts"),
    ("speed = 0.5", 'speed = "fast"', "options.speed: 'fast' is no whole number or number"),
    ("speed = 0.5", "spede = 0.5", "options.spede: there is no such key"),
    ("speed = 0.5", 'settings = "theirs"', "options.settings: 'theirs' is none of ours, published"),
    ('published = "square"', 'published = "circle"', "case[0].published: 'circle' is none of square, triangle, x, three"),
    ('shape = "square"', "shape = 3", "case[0].shape: 3 is no text"),
    ('cases = ["square"]', 'cases = ["circle"]', "quick.cases: 'circle' is none of square"),
    ('rule = "at_most"', 'rule = "about"', "bar[0].rule: 'about' is none of"),
    ("limit = 1", "", "bar[0].limit: is missing"),
    ("limit = 1", 'limit = 1\nagainst = "local"', "bar[0].cases: 'local' is none of square"),
    ('kind = "boxes"', 'kind = "pie"', "figure[0].kind: 'pie' is none of"),
    ('kind = "boxes"', 'kind = "bars"', "figure[0].figure: is missing"),
    ('title = "T"', 'title = "T', "no TOML"),
    ("[quick]", "[matrix]\nspeed = 3\n[quick]", "matrix.speed: 3 is no list"),
    ("[quick]", '[matrix]\nspeed = ["a"]\n[quick]', "matrix.speed: 'a' is no whole number"),
])
def test_a_bad_config_is_named_with_file_and_key(tmp_path, found, instead, words):
    file = tmp_path / "made-up.toml"
    file.write_text(GOOD)
    assert config.read_experiment(file).cases == [config.Case("square", {"speed": 0.5, "shape": "square"}, "square")]
    assert GOOD.count(found) >= 1
    file.write_text(GOOD.replace(found, instead, 1))
    with pytest.raises(config.ConfigError) as error:
        config.read_experiment(file)
    assert str(error.value).startswith(f"{file}: ") and words in str(error.value)


def test_a_matrix_is_every_combination_and_quick_changes_what_it_names(tmp_path):
    file = tmp_path / "made-up.toml"
    file.write_text(GOOD.split("[[case]]")[0] + '[matrix]\nrate = [30, 50]\nbatch_count = [1, 10]\n'
                    "[quick]\nseeds = 2\nmatrix = { rate = [30] }\noptions = { laps = 1, rate = 40 }\n")
    assert [case.options for case in config.read_experiment(file).cases] == [
        {"speed": 0.5, "rate": rate, "batch_count": count} for rate in (30, 50) for count in (1, 10)]
    quick = config.read_experiment(file, quick=True)
    assert quick.seeds == 2 and [case.options for case in quick.cases] == [
        {"speed": 0.5, "rate": 40, "batch_count": count, "laps": 1} for count in (1, 10)]


@pytest.fixture
def experiment(tmp_path):
    file = tmp_path / "made-up.toml"
    file.write_text(GOOD + '[[case]]\nname = "x"\nshape = "x"\n')
    return config.read_experiment(file)


@pytest.fixture
def place(tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/ledgerline-sim").write_text("one")
    return runs.Place(tmp_path / "bin", tmp_path, tmp_path, tmp_path / "running", "embedded", "disk")


def test_what_is_finished_is_kept_and_only_the_rest_is_run(tmp_path, monkeypatch, experiment, place):
    ran, interrupt_at = [], [3]

    def run(case, place, seed):
        ran.append((case.name, seed))
        if len(ran) == interrupt_at[0]:
            raise KeyboardInterrupt
        return {"figures": {"rms_m": 0.1 * seed, "finished": 1.0}, "why": ""}

    monkeypatch.setitem(runs.RUN, "flight", run)
    with pytest.raises(KeyboardInterrupt):
        main.measure(experiment, place, tmp_path, 2)
    assert ran == [("square", 1), ("x", 1), ("square", 2)]
    ran.clear()
    interrupt_at[0] = 0
    document = main.measure(experiment, place, tmp_path, 2)
    assert ran == [("square", 2), ("x", 2)]
    assert json.loads((tmp_path / "made-up.json").read_text()) == document
    assert document["spread"]["x"]["rms_m"]["low"] == 0.1 and document["spread"]["x"]["rms_m"]["count"] == 2
    assert [one["verdict"] for one in document["bars"]] == ["kept"]

    ran.clear()
    store.repetition_file(tmp_path, "made-up", "x", 2).write_text('{"asked"')  # torn
    main.measure(experiment, place, tmp_path, 2)
    assert ran == [("x", 2)]
    ran.clear()
    (place.programs / "ledgerline-sim").write_text("another")
    main.measure(experiment, place, tmp_path, 1)
    assert ran == [("square", 1), ("x", 1)], "figures of other programs are not taken for theirs"
    ran.clear()
    experiment.cases[0].options["speed"] = 0.6
    main.measure(experiment, place, tmp_path, 1)
    assert ran == [("square", 1)]


def test_every_case_has_a_file_of_its_own(tmp_path):
    for one in config.read_all():
        files = {store.repetition_file(tmp_path, one.name, case.name, 1) for case in one.cases}
        assert len(files) == len(one.cases), one.name


def test_what_was_not_measured_is_reported_and_measured_again(tmp_path, monkeypatch, experiment, place):
    def run(case, place, seed):
        if case.name == "x":
            raise runs.NotMeasured("no wind")
        return {"figures": {"rms_m": 0.1}, "why": ""}

    monkeypatch.setitem(runs.RUN, "flight", run)
    for _ in range(2):
        document = main.measure(experiment, place, tmp_path, 1)
        assert document["not_measured"] == [{"case": "x", "seed": 1, "why": "no wind"}]
        assert document["bars"][0]["verdict"] == "not measured" and "x" in document["bars"][0]["note"]


def scripted(place, name: str, text: str) -> None:
    """A verb that is a script."""
    place.work.mkdir(exist_ok=True)
    file = place.programs / "ledgerline"
    file.write_text(f'#!/bin/sh\n[ "$1" = {name} ] || exit 99\nshift\n{text}\n')
    file.chmod(0o755)


FLOWN_NOT = '{"ok": false, "why": "it never took off", "drones": [{"id": "tello1", "lap_s": [], "turns": []}], "cpu_percent": {}}'
JSON_OF_FLY = 'while [ "$1" != --json ]; do shift; done; '


@pytest.mark.parametrize("program, timeout_s, why", [
    (JSON_OF_FLY + f"echo '{FLOWN_NOT}' > $2; exit 1", 30, "it never took off"),
    ("echo a word >&2; kill -SEGV $$", 30, "ended with -11: a word"),
    (JSON_OF_FLY + "exit 3", 30, "ended with 3"),
    ("exec sleep 60", 1, "did not end in time")])
def test_a_flight_that_does_not_get_onto_its_path_has_failed(place, monkeypatch, program, timeout_s, why):
    monkeypatch.setattr(runs, "TIMEOUT_S", timeout_s)
    scripted(place, "fly", program)
    found = runs.flight(config.Case("c", {"ramp": "0.5:0.5", "laps": 2}), place, 1)
    assert found["figures"] == {"finished": 0.0, "fails": 1.0, "completed": 0.0, "top_speed_mps": 0.0, "top_lap_mps": 0.0, "top_peak_mps": 0.0,
                                "failed_at_mps": 0.5}
    assert why in found["why"] and found["ramp_end"] == "failed at 0.5 m/s"


@pytest.mark.parametrize("code", [1, 2])
def test_a_flight_that_fly_refused_to_begin_was_not_measured(place, code):
    scripted(place, "fly", f"echo no room >&2; exit {code}")
    with pytest.raises(runs.NotMeasured, match="no room"):
        runs.flight(config.Case("c", {}), place, 1)


def test_a_simulated_flight_that_crashes_has_failed_and_one_asked_wrongly_was_not_measured(place):
    scripted(place, "hil", "kill -SEGV $$")
    assert runs.sitl(config.Case("c", {}), place, 1)["figures"] == {"finished": 0.0, "fails": 1.0, "completed": 0.0}
    scripted(place, "hil", "echo bad >&2; exit 2")
    with pytest.raises(runs.NotMeasured, match="bad"):
        runs.sitl(config.Case("c", {}), place, 1)


def test_three_hosts_of_which_a_program_ends_have_failed(place, monkeypatch):
    def fly(*_):
        raise runs.three_hosts.Failed("link ended in flight: why")
    monkeypatch.setattr(runs.three_hosts, "fly", fly)
    found = runs.hosts(config.Case("c", {"shape": "square"}), place, 1)
    assert found["figures"] == {"finished": 0.0, "fails": 1.0, "completed": 0.0} and "link ended in flight" in found["why"]


class OnThisHost:
    """In a namespace's place."""

    def popen(self, *command, **options):
        return subprocess.Popen(list(map(str, command)), **options)


def test_a_program_that_is_never_ready_is_given_up_and_one_that_talks_does_not_wait_for_a_reader(tmp_path, monkeypatch):
    monkeypatch.setattr(runs.three_hosts, "READY_S", 30)
    talks = 'i=0; while [ $i -lt 3000 ]; do echo "{\\"line\\": \\"0123456789012345678901234567890123456789\\"}"; i=$((i+1)); done; '
    one = runs.three_hosts.Program(OnThisHost(), "talker", ["sh", "-c", talks + 'echo "{\\"ready\\": true}"; exec sleep 60'], tmp_path)
    assert one.wait_ready() is one
    one.end()
    assert one.process.poll() is not None
    monkeypatch.setattr(runs.three_hosts, "READY_S", 1)
    silent = runs.three_hosts.Program(OnThisHost(), "silent", ["sleep", "60"], tmp_path)
    with pytest.raises(runs.three_hosts.Failed, match="silent was not ready within 1 s"):
        silent.wait_ready()
    silent.end()
    monkeypatch.setattr(runs.three_hosts, "READY_S", 30)
    gone = runs.three_hosts.Program(OnThisHost(), "gone", ["sh", "-c", "echo last words >&2"], tmp_path)
    with pytest.raises(runs.three_hosts.Failed, match="gone ended before it was ready: last words"):
        gone.wait_ready()


@pytest.mark.parametrize("answer, why", [
    ([], "says nothing of ledgerline at 70"),
    ([{"client": "ledgerline", "rate": 70, "latencies_ms": [], "collapsed": False}], "no answer came to ledgerline at 70")])
def test_a_client_that_is_missing_in_the_answer_is_named(place, tmp_path, answer, why):
    (place.npm / "node_modules/@hyperledger/fabric-gateway").mkdir(parents=True)
    (tmp_path / "answer.json").write_text(json.dumps({"runs": answer, "ledger": {}}))
    scripted(place, "bench", JSON_OF_FLY + f"cp {tmp_path}/answer.json $2")
    with pytest.raises(runs.NotMeasured, match=why):
        runs.exchange(config.Case("c", {"rates": [70], "clients": ["ledgerline"], "ramp": "0.1:0.1", "laps": 3}), place, 1)


def test_figures_of_other_programs_or_scripts_are_others(place, tmp_path, monkeypatch):
    before = runs.digest(place, "hosts")
    for path in (place.programs / "ledgerline-roudi", place.programs.parent / "libexec/ledgerline/ledgerline-control"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("one")
        assert runs.digest(place, "hosts") != before
        before = runs.digest(place, "hosts")
    for kind, script in (("hosts", "hosts.py"), ("exchange", "client.cjs")):
        copies = {source: tmp_path / source.name for source in runs.SOURCES[kind]}
        for source, copy in copies.items():
            copy.write_bytes(source.read_bytes())
        monkeypatch.setitem(runs.SOURCES, kind, list(copies.values()))
        before = runs.digest(place, kind)
        with open(tmp_path / script, "a") as file:
            file.write("// more")
        assert runs.digest(place, kind) != before


def test_orderers_and_gateway_are_axes_of_fabric_alone():
    (load,) = [one for one in config.read_all() if one.name == "load"]
    fabric = [case for case in load.cases if case.on == "fabric"]
    asked = {(case.options.get("orderers", 1), case.options.get("gateway", False)) for case in fabric}
    assert asked == {(3, False), (1, True), (3, True)}
    assert not any("orderers" in case.options or "gateway" in case.options for case in load.cases if case.on is None)


def test_a_program_that_is_missing_is_named(place):
    with pytest.raises(runs.NotMeasured, match="ledgerline is not built: ninja -C build/release programs"):
        place.program("hil")


def test_options_become_arguments_of_a_command_line():
    assert runs.words({"batch_count": 10, "gateway": True, "mbedtls": False, "rates": [30, 70]}) == [
        "--batch-count", "10", "--gateway", "--rates", "30,70"]


def test_settings_are_the_ledgers_and_fabrics_orderers_only_fabrics(place):
    case = config.Case("c", {"settings": "published", "shape": "x"})
    assert runs.flight_options(case, place, 7) == {
        "batch_count": 10, "batch_timeout": "2s", "storage": "disk", "shape": "x", "ledger": "embedded", "seed": 7}
    assert runs.flight_options(config.Case("c", {"storage": "tmpfs"}), place, 7)["storage"] == "tmpfs"
    assert runs.flight_options(config.Case("c", {"ledger": "none"}), place, 7) == {"ledger": "none", "seed": 7}
    with pytest.raises(runs.NotMeasured, match="--gateway needs a ledger"):
        runs.flight_options(config.Case("c", {"gateway": True, "ledger": "none"}), place, 7)


def record(t_s: float, kind: int, identifier: int = 0, stamp_s: float = 0, v=(0, 0, 0, 0), drone: int = 1) -> bytes:
    return RECORD.pack(round(t_s * 1e9), kind, drone, 0, identifier, round(stamp_s * 1e9), *v)


def test_latency_is_of_the_first_of_each_plan(tmp_path):
    verified = TraceKind.COMMAND_VERIFIED
    (tmp_path / "agent.trace").write_bytes(
        EMPTY_TRACE + record(1.030, verified, 5, 1.0) + record(1.010, verified, 4, 1.0) + record(1.020, verified, 5, 1.0) +
        record(1.020, verified, 5, 1.015, drone=2) + b"torn")
    assert sorted(traces.latencies_ms(traces.read(tmp_path), TraceKind.COMMAND_VERIFIED)) == pytest.approx([5, 10, 20])
    assert len(traces.latencies_ms(traces.read(tmp_path), TraceKind.COMMAND_APPLIED)) == 0


def test_a_virtual_velocity_stands_at_its_states_moment_a_flown_one_at_its_own(tmp_path):
    data = EMPTY_TRACE
    for i in range(100):
        now = 0.1 * i
        data += record(now, TraceKind.TRUTH, v=(0.3 * now, 0.4 * now, 1, 0))
        data += record(now + 0.5, TraceKind.COMMAND_MADE, i, now, (now, 0, 0, 0))
        data += record(now + 1, TraceKind.COMMAND_APPLIED, i, now, (now, 0, 0, 0))
    (tmp_path / "all.trace").write_bytes(data)
    records = traces.read(tmp_path)
    speeds = traces.profile(records, 1, (2_000_000_000, 8_000_000_000))
    for t, true, flown, virtual in zip(*(speeds[key] for key in ("t_s", "true", "flown", "virtual"))):
        now = 2 + t
        assert true == pytest.approx(0.5, abs=0.01)
        assert virtual == pytest.approx(now, abs=0.02) and flown == pytest.approx(now - 1, abs=0.02)
    assert traces.track(records, 1, (0, 1_050_000_000))[-1] == pytest.approx([0.3, 0.4], abs=1e-3)


def test_laps_are_what_the_programs_say():
    turn = {"asked_mps": 1.0, "flown_mps": 0.7, "rms_m": 0.1, "max_m": 0.2}
    same = {"speed_mps": 1.0, "flown_mps": 0.7, "peak_mps": 1.1, "rms_m": 0.1, "max_m": 0.2, "seconds": 8.5, "finished": True}
    assert runs.flight_laps({"turns": [turn, turn], "lap_s": [8.5]}, [1.1]) == [same], "the second one did not end"
    assert runs.sitl_laps({"laps": [{**turn, "peak_mps": 1.1, "seconds": s} for s in (8.5, 0)]}) == [
        same, {**same, "seconds": 0, "finished": False}]
    assert runs.own_limit({"limit_mps": 2.0, "slowed_to_mps": None}) == {"limit_mps": 2.0}


def test_the_greatest_speed_is_that_of_each_finished_lap(tmp_path):
    data, x = EMPTY_TRACE, 0.0
    for i in range(600):  # 1 m/s for 2 s, then 2 m/s for 2 s, then 3 m/s
        now = 0.01 * i
        x += 0.01 * (1 + int(now / 2))
        data += record(now, TraceKind.TRUTH, v=(x, 0, 1, 0))
    (tmp_path / "sim.trace").write_bytes(data)
    records = traces.read(tmp_path)
    path = {"number": 1, "between": (200_000_000, 6_000_000_000), "lap_s": [1.6, 1.9]}
    assert traces.lap_peaks(records, path) == pytest.approx([1, 2], abs=0.02)
    assert traces.lap_peaks(records, None) == []


def test_paths_are_what_the_one_who_flew_says(tmp_path):
    (tmp_path / "ground.summary.json").write_text(json.dumps({"drones": [
        {"name": "tello1", "origin": [1, 2], "path_ns": [5, 9], "lap_s": [3.5]},
        {"name": "tello2", "origin": [0, 0], "path_ns": [0, 0]}]}))
    (tmp_path / "link.summary.json").write_text(json.dumps({"drones": [{"name": "tello1"}]}))
    (tmp_path / "sim.summary.json").write_text("{")
    assert traces.paths(tmp_path) == {"tello1": {"between": (5, 9), "origin": [1, 2], "number": 1, "lap_s": [3.5]}}


def test_an_error_is_the_distance_to_the_nearest_piece_of_the_path():
    square = traces.corners("square", 2, (1, 1))
    assert square.tolist() == [[1, 1], [3, 1], [3, 3], [1, 3], [1, 1]]
    assert traces.cross_track([(2, 1), (2, 1.3), (3.4, 3)], square) == pytest.approx({"rms": (0.25 / 3) ** 0.5, "max": 0.4})
    assert traces.corners("eight", 2, (0, 0)) is None


def test_a_file_that_is_no_trace_is_refused(tmp_path):
    (tmp_path / "old.trace").write_bytes(b"LLTRACE0" + bytes(8) + record(1, TraceKind.TRUTH))
    with pytest.raises(ValueError, match="old.trace: no trace of this version"):
        traces.read(tmp_path)
