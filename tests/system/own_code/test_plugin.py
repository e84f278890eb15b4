"""A controller as a plug-in: in simulated time over many seeds, and with the real processes."""
import json

from flights import assert_nothing_left
from own_code import BIN, SCENARIOS, broken, run

CONTROLLERS = BIN.parent / "controllers"


def test_planted_it_is_caught_and_repaired_it_passes(tmp_path):
    for name, code in (("example_controller", 0), ("planted_controller", 1)):
        done = run(SCENARIOS / "plugin-slow-ledger.toml", "--controller", CONTROLLERS / f"{name}.so", "--seeds", "1..10", "--jobs", "2",
                   "--junit", tmp_path / f"{name}.xml")
        assert done.returncode == code, name
        assert (tmp_path / f"{name}.xml").read_text().count("<testcase") > 0
    assert "10 broken" in done.stdout


def test_it_flies_with_the_real_processes(tmp_path):
    script = tmp_path / "script.toml"
    script.write_text('title = "t"\nmust = ["finishes", "path within 0.4 m", "corners within 0.4 m"]\n'
                      '[flight]\nwaypoints = ["0,0", "1,0", "1,1,1.2", "0,1"]\n')
    done = run(script, "--real", "--shim", "--out", tmp_path / "out", "--json", tmp_path / "r.json", "--controller",
               CONTROLLERS / "example_controller.so")
    flown = json.loads((tmp_path / "r.json").read_text())["runs"][0]
    assert done.returncode == 0, broken(flown)
    assert 'transport = "shim"' in (tmp_path / "out/script-1/run/link.toml").read_text()
    assert "controller = " in (tmp_path / "out/script-1/run/ground.toml").read_text()
    assert_nothing_left()


def test_what_is_no_controller_is_refused_by_name(tmp_path):
    no_library = tmp_path / "my.so"
    no_library.write_text("no library")
    done = run(SCENARIOS / "plugin-slow-ledger.toml", "--controller", no_library)
    assert done.returncode == 2 and "my.so cannot be loaded" in done.stderr
