"""What the experiments' figures and verdicts are made of: statistics, configs, what is kept of an interrupted one."""
import json
import re
import struct

import config
import main
import pytest
import runs
import store
import traces
import verdicts
from conftest import ROOT

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


def lap(speed: float, error: float, finished: bool = True, flown: float = 0.0, seconds: float = 10.0, rms: float = 0.1) -> dict:
    return {"speed_mps": speed, "max_m": error, "finished": finished, "flown_mps": flown, "seconds": seconds, "rms_m": rms}


def test_the_top_speed_is_that_of_the_last_good_lap():
    laps = [lap(0.5, 0.1, flown=0.45), lap(1.0, 0.39, flown=0.8), lap(1.5, 0.4, flown=1.2), lap(2.0, 0.1, flown=1.5)]
    assert verdicts.ramp_figures(laps) == {"top_speed_mps": 1.0, "top_lap_mps": 0.8}
    assert verdicts.ramp_figures(laps[2:]) == {"top_speed_mps": 0, "top_lap_mps": 0}
    assert verdicts.ramp_figures([lap(0.5, 0.1, flown=0.4), lap(1.0, 0.1, finished=False)])["top_speed_mps"] == 0.5


def test_what_is_learned_is_judged_from_the_third_lap_on():
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
    text = (ROOT / "ground/report/published.hpp").read_text()
    there = {name: tuple(map(float, values)) for name, *values in
             re.findall(r'PublishedBox\{"([^"]+)", ([.\d]+), ([.\d]+), ([.\d]+), ([.\d]+), ([.\d]+)\}', text)}
    boxes = {"3 drones" if name == "three" else name: tuple(box[key] for key in ("low", "q1", "median", "q3", "high"))
             for name, box in config.read_published()["box"].items()}
    assert boxes == there


def test_every_config_reads_whole_and_quick():
    whole, quick = config.read_all(), config.read_all(quick=True)
    assert [one.number for one in whole] == list(range(1, 12))
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
    ('runs = "flight"', 'runs = "walk"', "runs: 'walk' is none of flight, virtual, exchange, hosts"),
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
    (tmp_path / "bin/ledgerline-fly").write_text("one")
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
    (place.programs / "ledgerline-fly").write_text("another")
    main.measure(experiment, place, tmp_path, 1)
    assert ran == [("square", 1), ("x", 1)], "figures of other programs are not taken for theirs"
    ran.clear()
    experiment.cases[0].options["speed"] = 0.6
    main.measure(experiment, place, tmp_path, 1)
    assert ran == [("square", 1)]


def test_what_was_not_measured_is_said_and_is_asked_for_again(tmp_path, monkeypatch, experiment, place):
    def run(case, place, seed):
        if case.name == "x":
            raise runs.NotMeasured("no wind")
        return {"figures": {"rms_m": 0.1}, "why": ""}

    monkeypatch.setitem(runs.RUN, "flight", run)
    for _ in range(2):
        document = main.measure(experiment, place, tmp_path, 1)
        assert document["not_measured"] == [{"case": "x", "seed": 1, "why": "no wind"}]
        assert document["bars"][0]["verdict"] == "not measured" and "x" in document["bars"][0]["note"]


def test_a_program_that_is_missing_is_named(place):
    with pytest.raises(runs.NotMeasured, match="ninja -C build/release ledgerline-hil"):
        place.program("hil")


def test_options_become_words_of_a_command_line():
    assert runs.words({"batch_count": 10, "gateway": True, "majority": False, "rates": [30, 70]}) == [
        "--batch-count", "10", "--gateway", "--rates", "30,70"]


def test_settings_are_the_ledgers_and_fabrics_orderers_only_fabrics(place):
    case = config.Case("c", {"settings": "published", "shape": "x"})
    assert runs.flight_options(case, place, 7) == {
        "batch_count": 10, "batch_timeout": "2s", "storage": "disk", "shape": "x", "ledger": "embedded", "seed": 7}
    assert runs.flight_options(config.Case("c", {"storage": "tmpfs"}), place, 7)["storage"] == "tmpfs"
    assert runs.flight_options(config.Case("c", {"ledger": "none"}), place, 7) == {"ledger": "none", "seed": 7}
    with pytest.raises(runs.NotMeasured, match="--gateway needs --ledger fabric"):
        runs.flight_options(config.Case("c", {"gateway": True}), place, 7)


def record(t_s: float, kind: int, identifier: int = 0, stamp_s: float = 0, v=(0, 0, 0, 0), drone: int = 1) -> bytes:
    return struct.pack("<qHHIQq4d", round(t_s * 1e9), kind, drone, 0, identifier, round(stamp_s * 1e9), *v)


def test_latency_is_of_the_first_of_each_plan(tmp_path):
    verified = traces.COMMAND_VERIFIED
    (tmp_path / "agent.trace").write_bytes(
        bytes(16) + record(1.030, verified, 5, 1.0) + record(1.010, verified, 4, 1.0) + record(1.020, verified, 5, 1.0) +
        record(1.020, verified, 5, 1.015, drone=2) + b"torn")
    assert sorted(traces.latencies_ms(traces.read(tmp_path), traces.COMMAND_VERIFIED)) == pytest.approx([5, 10, 20])
    assert len(traces.latencies_ms(traces.read(tmp_path), traces.COMMAND_APPLIED)) == 0


def test_a_virtual_velocity_stands_at_its_states_moment_a_flown_one_at_its_own(tmp_path):
    data = bytes(16)
    for i in range(100):
        now = 0.1 * i
        data += record(now, traces.TRUTH, v=(0.3 * now, 0.4 * now, 1, 0))
        data += record(now + 0.5, traces.COMMAND_MADE, i, now, (now, 0, 0, 0))
        data += record(now + 1, traces.COMMAND_APPLIED, i, now, (now, 0, 0, 0))
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
    same = {"speed_mps": 1.0, "flown_mps": 0.7, "rms_m": 0.1, "max_m": 0.2, "seconds": 8.5, "finished": True}
    assert runs.flight_laps({"turns": [turn, turn], "lap_s": [8.5]}) == [same], "the second one did not end"
    assert runs.virtual_laps({"laps": [{**turn, "seconds": 8.5}, {**turn, "seconds": 0}]}) == [
        same, {**same, "seconds": 0, "finished": False}]
    assert runs.own_limit({"limit_mps": 2.0, "slowed_to_mps": None}) == {"limit_mps": 2.0}


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
