"""scripts/capacity: its formula is that of the points, and it measures."""
import json
import os
import pathlib
import subprocess
import sys

import pytest

TREE = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(TREE / "tools/capacity"))
from fit import Undetermined, fit, least_squares


def test_the_formula_is_found_again():
    points = [{"drones": d, "hosts": h, "channels": c, "cpu": 5 + 2 * d + 3 * h - 0.5 * c}
              for d, h, c in ((1, 1, 1), (4, 1, 1), (16, 1, 1), (4, 2, 1), (4, 3, 1), (4, 1, 2), (4, 1, 4))]
    found = fit(points, ("drones", "hosts", "channels"), "cpu")
    assert found["constant"] == pytest.approx(5) and found["residual_max"] < 1e-9
    assert found["terms"] == {"drones": pytest.approx(2), "hosts": pytest.approx(3), "channels": pytest.approx(-0.5)}
    points[0]["cpu"] += 7
    assert fit(points, ("drones", "hosts", "channels"), "cpu")["residual_max"] > 1


def test_points_that_tell_nothing_apart_are_refused():
    with pytest.raises(Undetermined, match="2 points for 3"):
        least_squares([[1, 1, 1], [1, 2, 1]], [1, 2])
    with pytest.raises(Undetermined, match="does not vary by itself"):
        least_squares([[1, 1, 1], [1, 2, 2], [1, 3, 3]], [1, 2, 3])
    assert fit([{"drones": 2, "cpu": 1}, {"drones": 2, "cpu": 3}], ("drones",), "cpu")["terms"] == {}, "part of the constant"


@pytest.mark.parametrize("words", [("--point", "4,2"), ("--point", "1,2,1"), ("--point", "17,1,1"), ("--repeat", "0")])
def test_what_cannot_be_measured_is_refused(words):
    done = subprocess.run([sys.executable, TREE / "tools/capacity/main.py", *words], capture_output=True, text=True, timeout=30)
    assert done.returncode == 2 and words[0] in done.stderr


@pytest.mark.skipif(os.environ.get("LEDGERLINE_LONG") != "1", reason="LEDGERLINE_LONG=1")
def test_each_process_of_a_fleet_on_two_hosts_and_two_channels_is_measured(tmp_path):
    done = subprocess.run([sys.executable, TREE / "tools/capacity/main.py", "--point", "4,2,2", "--repeat", "1", "--seconds", "2",
                           "--json", tmp_path / "capacity.json"], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    (run,) = json.loads((tmp_path / "capacity.json").read_text())["runs"]
    served = sorted((one["kind"], one["drones"], one["streams"]) for one in run["processes"])
    assert served == [("agent", 2, 2)] * 2 + [("ground", 4, 4)] + [("link", 2, 2)] * 2 + [("node", 2, 2)] * 2 + [
        ("roudi", 2, 2)] * 2 + [("sim", 2, 2)] * 2
    assert all(one["cpu_percent"] > 0 for one in run["processes"] if one["kind"] != "roudi") and run["on_path"] == 4
    states = run["states"]
    assert states["sampled"] == sum(states[key] for key in ("on_ledger", "merged", "dropped", "pending")) > 0
