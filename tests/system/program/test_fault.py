"""The tools around fault scripts: list, check, new, schema, compare, and a run by name. Flights in simulated time alone."""
import json
import pathlib
import re
import signal
import subprocess
import time
import tomllib

import fastjsonschema
import pytest
from programs import BIN

ROOT = pathlib.Path(__file__).resolve().parents[3]
SCENARIOS = sorted((ROOT / "hil/scenarios").rglob("*.toml"))
WORKFLOW = ROOT / "docs/examples/fault-runs.yml"


def fault(*words, expect: int = 0, cwd=None) -> subprocess.CompletedProcess:
    done = subprocess.run([BIN / "ledgerline", "fault", *map(str, words)], capture_output=True, text=True, timeout=200, cwd=cwd)
    assert done.returncode == expect, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> pathlib.Path:
    """Results of one short script with seeds 1 to 3."""
    directory = tmp_path_factory.mktemp("flown")
    (directory / "short.toml").write_text('title = "t"\nmust = ["ends within 60 s"]\n[[fault]]\nwhat = "operator stop tello1"\nat = "height 0.5"\n')
    fault("run", "short.toml", "--seeds", "1..3", "--json", "r.json", "--quiet", cwd=directory)
    return directory / "r.json"


def test_a_new_script_is_fine_and_is_not_overwritten(tmp_path):
    fault("new", "mine", cwd=tmp_path)
    assert "fine: 1 drone, 1 fault, 4 rules" in fault("check", "mine.toml", cwd=tmp_path).stdout
    fault("check", "mine.toml", "--real", cwd=tmp_path)
    before = (tmp_path / "mine.toml").read_text()
    assert "left as it is" in fault("new", "mine.toml", expect=2, cwd=tmp_path).stderr
    assert (tmp_path / "mine.toml").read_text() == before
    fault("new", 'a"b', expect=2, cwd=tmp_path)


def test_check_says_file_line_and_key_and_flies_nothing(tmp_path):
    script = tmp_path / "bad.toml"
    script.write_text('title = "t"\nmust = ["flies well"]\n[[fault]]\nwhat = "mocap tello1 frozen"\nwings = 2\n')
    reported = fault("check", script, expect=2).stderr
    assert f"{script}:2: must: " in reported and f"{script}:5: fault.0.wings: unknown key" in reported
    script.write_text('title = "t"\n[[fault]]\nwhat = "mocap tello1 frozen"\n')
    fault("check", script)
    assert f'{script}:3: fault.0.what: "mocap tello1 frozen": it is inside' in fault("check", script, "--real", expect=2).stderr


def test_list_has_every_scenario_and_says_modes():
    rows = json.loads(fault("list", "--json").stdout)
    assert {row["name"] for row in rows} == {file.stem for file in SCENARIOS}
    assert all(row["title"] and row["group"] == pathlib.Path(row["file"]).parent.name for row in rows)
    assert {row["real"] for row in rows} == {True, False}
    assert {row["name"] for row in rows if not row["sitl"]} >= {"ros2-gap", "sdk-client-errors"}
    shown = fault("list", "faults").stdout
    assert re.search(r"^drone NAME reboot +sitl$", shown, re.M) and re.search(r"^roudi kill +real$", shown, re.M)
    assert re.search(r"^sends COMMAND +sitl \(the traces", fault("list", "rules").stdout, re.M)
    assert "command_age_median_ms" in fault("list", "figures").stdout
    assert {row["group"] for row in json.loads(fault("list", "fence", "--json").stdout)} == {"fence"}
    assert "no scenario or group" in fault("list", "nowhere", expect=2).stderr


def test_a_scenario_flies_by_its_name_from_anywhere(tmp_path):
    assert "held   blind-end" in fault("run", "blind-end", cwd=tmp_path).stdout
    assert "no scenario or group of this name" in fault("run", "wings", expect=2, cwd=tmp_path).stderr


def test_scripts_of_one_name_are_refused(flown, tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.toml").write_text((flown.parent / "short.toml").read_text())
    reported = fault("run", "a/x.toml", "b/x.toml", expect=2, cwd=tmp_path).stderr
    assert "a/x.toml and b/x.toml: two scripts of one name, x" in reported


def test_what_is_not_flown_is_in_the_files(flown, tmp_path):
    folder = tmp_path / "scripts"
    folder.mkdir()
    (folder / "short.toml").write_text((flown.parent / "short.toml").read_text())
    (folder / "client.toml").write_text('title = "t"\n[flight]\nkind = "sdk"\n')
    fault("run", folder, "--junit", "j.xml", "--json", "j.json", cwd=tmp_path)
    results = json.loads((tmp_path / "j.json").read_text())
    assert results["held"] and [(row["script"], row["error"]) for row in results["not_flown"]] == [("client", False)]
    assert [row["mode"] for row in results["figures"]] == ["sitl"]
    assert 'tests="2" failures="0" errors="0" skipped="1"' in (tmp_path / "j.xml").read_text()
    # A file where its folder should be keeps a real flight from its beginning.
    (tmp_path / "out").mkdir()
    (tmp_path / "out/short-1").write_text("")
    fault("run", "--real", "--out", "out", folder / "short.toml", "--junit", "r.xml", "--json", "r.json", expect=1, cwd=tmp_path)
    results = json.loads((tmp_path / "r.json").read_text())
    assert not results["held"] and results["figures"] == []
    assert [(row["script"], row["seed"], row["error"]) for row in results["not_flown"]] == [("short", 1, True)]
    assert re.search(r'classname="short" name="seed 1">\s+<error message="', (tmp_path / "r.xml").read_text())


def interrupted(*words, until: str, stream: str, cwd) -> tuple[str, str]:
    """What a campaign printed that gets SIGINT once `until` is in a line of its `stream`."""
    with open(cwd / "stdout", "w") as out, open(cwd / "stderr", "w") as err:
        process = subprocess.Popen([BIN / "ledgerline", "fault", *words], stdout=out, stderr=err, cwd=cwd)
        deadline = time.monotonic() + 120
        while until not in (cwd / stream).read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
    return (cwd / "stdout").read_text(), (cwd / "stderr").read_text()


def test_an_interrupt_keeps_what_was_flown(flown, tmp_path):
    files = ("--json", "r.json", "--html", "r.html", "--csv", "r.csv", "--junit", "r.xml")
    out, _ = interrupted("run", str(flown.parent / "short.toml"), "--seeds", "1..100000", *files, until="held", stream="stdout", cwd=tmp_path)
    assert re.search(r"^interrupted: \d+ of 100000 runs flown$", out, re.M)
    results = json.loads((tmp_path / "r.json").read_text())
    assert results["interrupted"] and not results["held"] and 0 < results["flown"] < 100_000
    assert len((tmp_path / "r.csv").read_text().splitlines()) == results["flown"] + 1
    assert "of 100000 runs flown" in (tmp_path / "r.html").read_text() and 'errors="1"' in (tmp_path / "r.xml").read_text()


def test_a_long_campaign_says_how_far_it_is(tmp_path):
    out, err = interrupted("random", "--seeds", "1..100000", "--json", "r.json", until=" of 100000", stream="stderr", cwd=tmp_path)
    assert re.fullmatch(r"(\d+ of 100000, \d+ broken\n){1,3}(shrinking .*\n)*", err) and "interrupted: " in out
    assert json.loads((tmp_path / "r.json").read_text())["interrupted"]


def test_check_refuses_what_run_refuses_over_the_shim(tmp_path):
    (tmp_path / "client.toml").write_text('title = "t"\n[flight]\nkind = "sdk"\n')
    for words in (("check", "--real", "--shim"), ("run", "--real", "--shim", "--out", "out", "--program", "true")):
        assert "flight.kind: an SDK client speaks UDP" in fault(*words, "client.toml", expect=2, cwd=tmp_path).stderr
    fault("check", "--real", "client.toml", cwd=tmp_path)


def test_an_installed_program_finds_its_scenarios_beside_it(tmp_path):
    for part in ("common", "tools"):
        subprocess.run(["cmake", "--install", BIN.parent, "--component", part, "--prefix", tmp_path], check=True, capture_output=True)
    listed = subprocess.run([tmp_path / "bin/ledgerline", "fault", "list", "--json"], capture_output=True, text=True, check=True)
    rows = json.loads(listed.stdout)
    assert len(rows) == len(SCENARIOS)
    assert all(row["file"].startswith(str(tmp_path / "share/ledgerline/scenarios")) for row in rows)
    installed = (tmp_path / "share/ledgerline/fault-script.schema.json").read_text()
    assert installed == fault("schema").stdout


def test_every_scenario_is_valid_by_the_schema_and_what_is_wrong_is_not():
    validate = fastjsonschema.compile(json.loads(fault("schema").stdout))
    for file in SCENARIOS:
        validate(tomllib.loads(file.read_text()))
    for wrong in ('title = "t"\nwings = 2\n', "seed = 1\n", 'title = "t"\n[flight]\nlaps = 0\n', 'title = "t"\nmust = ["flies well"]\n',
                  'title = "t"\n[[fault]]\nwhat = "drone tello1 sideways"\n', 'title = "t"\n[[fault]]\nat = "path"\n',
                  'title = "t"\n[[fault]]\nwhat = "ledger stall"\nfor = "long"\n', 'title = "t"\n[flight]\nlimit = "soon"\n'):
        with pytest.raises(fastjsonschema.JsonSchemaException):
            validate(tomllib.loads(wrong))


def test_equal_runs_are_equal_and_a_regression_is_not(flown, tmp_path):
    again = tmp_path / "again.json"
    again.write_text(flown.read_text())
    assert "equal: the same bytes" in fault("compare", flown, again).stdout

    def changed(seeds: int, change) -> pathlib.Path:
        """Results of `seeds` runs, as flown or changed."""
        results = json.loads(flown.read_text())
        rows = [{**results["figures"][0], "seed": seed, "digest": f"{seed}", "figures": dict(results["figures"][0]["figures"])}
                for seed in range(1, seeds + 1)]
        for row in rows:
            change(row)
        path = tmp_path / f"{change.__name__}-{seeds}.json"
        path.write_text(json.dumps({"figures": rows}))
        return path

    def as_flown(row):
        row["figures"]["flown_s"] += row["seed"] % 7 / 100

    def later(row):
        row["digest"] += "-later"
        row["figures"]["flown_s"] += 1 + row["seed"] % 5 / 100

    def breaks(row):
        row["digest"] += "-breaks"
        row["broken"] = ["finishes"] if row["seed"] == 3 else []

    reported = fault("compare", changed(30, as_flown), changed(30, later), "--json", tmp_path / "c.json", expect=1).stdout
    assert re.search(r"^worse +short +flown_s", reported, re.M) and reported.endswith("\nregression\n")
    assert json.loads((tmp_path / "c.json").read_text())["verdict"] == "regression"
    assert "improvement" in fault("compare", changed(30, later), changed(30, as_flown)).stdout
    assert "newly with seed 3" in fault("compare", changed(30, as_flown), changed(30, breaks), expect=1).stdout
    assert "too few runs to tell" in fault("compare", changed(3, as_flown), changed(3, later), expect=2).stdout
    (tmp_path / "none.json").write_text("{}")
    assert "none.json: figures: must be" in fault("compare", flown, tmp_path / "none.json", expect=2).stderr


def test_the_example_workflow_asks_for_what_there_is():
    calls = re.findall(r"ledgerline fault ([a-z]+) (.*)", WORKFLOW.read_text().replace("\\\n", " "))
    assert {verb for verb, _ in calls} >= {"check", "run", "compare"}
    for verb, words in calls:
        known = fault(verb, "--help").stdout
        for option in re.findall(r"--[a-z-]+", words):
            assert re.search(rf"{option}\b", known), f"{verb} has no {option}"
    flies = [words for verb, words in calls if verb == "run"]
    assert flies
    for words in flies:
        for name in words.split(" --")[0].split():
            assert json.loads(fault("list", name, "--json").stdout), name
    for path in re.findall(r"\b((?:hil|scripts)/[\w/-]+)", WORKFLOW.read_text()):
        assert (ROOT / path).exists() or any(ROOT.glob(path + ".*")), path


def test_the_example_workflow_compares_and_keeps_runs_that_broke():
    steps = dict(re.findall(r"^      - name: (.+)\n((?:        .*\n)+)", WORKFLOW.read_text(), re.M))
    for name in ("Figures of main", "Which figures", "Compare", "They are the new figures of main", "Keep them", "Keep what was seen"):
        condition = re.search(r"^        if: (.+)$", steps[name], re.M)
        assert condition and "!cancelled()" in condition[1] and condition[1].startswith("${{"), name  # else a step waits for success
    for name in ("Compare", "They are the new figures of main", "Keep them"):
        assert "hashFiles('faults.json') != ''" in steps[name], name
    reported = steps["Which figures"]
    assert "cache-matched-key" in reported and "no figures of main" in reported
