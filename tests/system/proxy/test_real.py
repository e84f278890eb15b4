"""`ledgerline fault run --real`: fault scripts on the real processes, and beside the simulated run of the same script."""
import json
import os
import pathlib
import subprocess

import pytest

from fabric import needs_fabric
from flights import BIN, assert_nothing_left

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
TIMEOUT_S = 600  # not a limit on speed: only how long a broken test may take
long_only = pytest.mark.skipif(not LONG, reason="flights in real time take minutes: LEDGERLINE_LONG=1")


def needs_a_disk_of_its_own(directory: pathlib.Path) -> None:
    mounted = subprocess.run(["unshare", "--mount", "mount", "-t", "tmpfs", "none", directory], capture_output=True, text=True)
    if mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here, which needs root or a user namespace: {mounted.stderr.strip()}")


def run(directory: pathlib.Path, text: str, *options: str) -> subprocess.CompletedProcess:
    script = directory / "script.toml"
    script.write_text(text)
    done = subprocess.run([BIN / "ledgerline", "fault", "run", script, "--real", "--out", directory / "out", *options],
                          capture_output=True, text=True, timeout=TIMEOUT_S)
    print(done.stdout, done.stderr, flush=True)
    return done


def test_what_the_real_processes_cannot_have_is_refused_before_anything_flies(tmp_path):
    done = run(tmp_path, 'title = "t"\nmust = ["sends emergency"]\n[[fault]]\nwhat = "mocap tello1 frozen"\n'
                         '[[fault]]\nwhat = "peer 1 kill"\n')
    assert done.returncode == 2
    for why in ("inside of the simulation", "a part of Fabric", "the traces do not tell it"):
        assert why in done.stderr
    assert run(tmp_path, 'title = "t"\n', "--jobs", "2").returncode == 2
    assert not (tmp_path / "out").exists()


@long_only
@pytest.mark.parametrize("flight", ["laps = 1", 'shape = "triangle"\nspeed_mps = 0.8', "drones = 3"])
def test_a_flight_without_faults_goes_as_its_simulated_run_does(tmp_path, flight):
    done = run(tmp_path, f'title = "t"\nmust = ["finishes", "path within 0.4 m", "hold is never seen"]\n[flight]\n{flight}\n')
    assert done.returncode == 0 and "agrees with its simulated run: the same transitions" in done.stdout
    assert_nothing_left()


FAULTS = {  # what, for how long, and what must hold besides
    "ledger stall": (["ledger stall"], "2s", ["hold is seen", "resumes within 3 s"]),
    "ground cut": (["ledger ground cut"], "2s", ["hold is seen"]),
    "delay": (["ledger both delay 15ms"], "5s", []),
    "drone": (["drone tello1 both delay 30ms, loss 5%, duplicate 5%, reorder 5% 20ms"], "5s", []),
    "sensor": (["sensor tello1 tof garbage"], "2s", ["state stale is seen", "resumes within 3 s"]),
    "overlap": (["drone tello1 to delay 20ms", "drone * to delay 40ms"], "2s", []),
    "disk": (["disk full"], "2s", ["hold is seen", "ledger silent is seen", "resumes within 3 s", "nothing acknowledged is lost"]),
    "agent stop": (["agent stop"], "2s", ["agent silent is seen", "resumes within 3 s"]),
    "agent kill": (["agent kill"], "500ms", []),
    "link kill": (["link kill"], "500ms", []),
    "roudi kill": (["roudi kill"], None, ["hold is never seen"]),
    "cpu": (["cpu 0 burn", "cpu 1 burn"], "5s", []),
    "memory": (["memory take 2000MB"], "5s", []),
}


@long_only
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_in_mid_lap_is_survived(tmp_path, name):
    if name == "disk":
        needs_a_disk_of_its_own(tmp_path)
    faults, lasts, rules = FAULTS[name]
    tables = "".join(f'[[fault]]\nwhat = "{what}"\nat = "path + 2s"\n' + (f'for = "{lasts}"\n' if lasts else "") for what in faults)
    must = ["finishes", "no crash", "land is never seen", "path within 0.5 m", *rules]
    done = run(tmp_path, f'title = "{name}"\nmust = {json.dumps(must)}\n{tables}', "--json", str(tmp_path / "r.json"))
    assert done.returncode == 0
    flown = json.loads((tmp_path / "r.json").read_text())["runs"][0]
    unchecked = {verdict["rule"] for verdict in flown["verdicts"] if verdict["held"] is None}
    assert len(flown["not_checked"]) + len(unchecked) == 7
    assert "always: nothing is flown that nobody signed" in unchecked
    events = flown["events"]
    assert [e["text"] for e in events if e["kind"] == "fault" and e["text"].endswith(" begins")] == [f"{f} begins" for f in faults]
    assert_nothing_left()


@long_only
@pytest.mark.parametrize("part", ["orderer leader", "peer 1", "orderer 1", "orderer 2", "orderer 3", "chaincode 1"])
def test_a_part_of_fabric_dies_in_mid_lap(tmp_path, part):
    needs_fabric()
    done = run(tmp_path, f'title = "{part}"\nmust = ["finishes", "no crash", "land is never seen", "path within 0.5 m"]\n'
                         f'[[fault]]\nwhat = "{part} kill"\nat = "path + 2s"\n', "--ledger", "fabric")
    assert done.returncode == 0
