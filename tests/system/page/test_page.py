"""The ground station's page in a real browser, flown as a person would: drive.mjs and crew.mjs have the steps."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import threading

import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, pid_of, printed
from station import Station, is_ready

HERE = pathlib.Path(__file__).parent
NPM = pathlib.Path(os.environ["LEDGERLINE_NPM"]).parent / "npm-page"
MAX_BYTES = 200_000  # of a load: what a slow link carries in a second or two
MAX_REQUESTS = 35  # of the same: the page, its style, and a module each, which index.html names, so that they are asked for at once
MAX_SPACE_BYTES, MAX_SPACE_REQUESTS = 600_000, 8  # of the 3-D view, once it is asked for: three.js, as gzip has it


def start(tmp_path: pathlib.Path, *options: str) -> tuple[subprocess.Popen, Station]:
    """A flight by hand of two drones, which both stand on the ground."""
    if shutil.which("node") is None or not (NPM / "node_modules").is_dir():
        pytest.skip("Node.js or the page's packages are missing (./run-tests installs them)")
    if not (NPM.parent / "npm-station" / "node_modules").is_dir():
        pytest.skip("the page is built without its libraries (./run-tests installs them)")
    flight = fly(tmp_path, "--drones", "2", "--shape", "manual", "--watch", *options)
    station = Station(tmp_path, flight)
    for name in ("tello1", "tello2"):
        station.wait(name, is_ready)
    return flight, station


def drive(script: str, station: Station, pictures: pathlib.Path, *arguments: str) -> dict:
    """What the script saw."""
    done = subprocess.run(["node", HERE / script, f"{station.url}/#token={station.token}", pictures, *arguments],
                          env={**os.environ, "LEDGERLINE_PAGE_NPM": str(NPM)}, stdout=subprocess.PIPE, text=True, timeout=400)
    print(done.stdout)
    saw = json.loads(done.stdout)
    assert done.returncode == 0 and not saw["wrong"], saw
    assert saw["console_errors"] == [] and all(not found for found in saw["axe"].values()), saw
    return saw


def kill_ground_when_asked(asked: pathlib.Path, over: threading.Event) -> None:
    while not asked.exists():
        if over.wait(0.05):
            return
    os.kill(pid_of("ledgerline-ground"), signal.SIGKILL)


def end(flight: subprocess.Popen, tmp_path: pathlib.Path) -> None:
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()


@pytest.mark.essential
def test_a_person_flies_by_the_page(tmp_path):
    flight, station = start(tmp_path, "--fault-switches")
    over = threading.Event()
    killer = threading.Thread(target=kill_ground_when_asked, args=(tmp_path / "pictures" / "kill-ground", over))
    killer.start()
    try:
        saw = drive("drive.mjs", station, tmp_path / "pictures")
    finally:
        over.set()
        killer.join()
    assert saw["away"].startswith("Ground was away for"), saw
    assert saw["bytes"] < MAX_BYTES and saw["requests"] <= MAX_REQUESTS, saw
    assert saw["space"]["bytes"] < MAX_SPACE_BYTES and saw["space"]["requests"] <= MAX_SPACE_REQUESTS, saw
    assert {"ledger-delayed", "ledger-stalled", "silent-tello1", "commands-lost-tello2"} <= set(saw["faults"]), saw
    assert {"Taking off", "By hand", "On its path", "Landed"} <= set(saw["phases"]), saw
    end(flight, tmp_path)


def test_two_operators_share_the_drones_at_their_pages(tmp_path):
    flight, station = start(tmp_path, "--operators", "alice,bob")
    phrases = dict(re.findall(r"Operator (\w+): pass phrase (\S+)", printed(tmp_path)))
    saw = drive("crew.mjs", station, tmp_path / "pictures", phrases["alice"], phrases["bob"])
    assert saw["signed_in"][:2] == ["alice", "bob"] and saw["sent_in_vain"] == 0, saw
    for words in ("alice: take control", "bob: ask for control", "alice: hand over", "alice: clear the stop", "bob: clear the stop"):
        assert f"tello1: {words}" in saw["events"], saw["events"]
    end(flight, tmp_path)
