"""The ground station's page in a real browser, flown as a person would: drive.mjs has the steps."""
import json
import os
import pathlib
import shutil
import signal
import subprocess

import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, printed
from station import Station

HERE = pathlib.Path(__file__).parent
NPM = pathlib.Path(os.environ["LEDGERLINE_NPM"]).parent / "npm-page"
MAX_BYTES, MAX_REQUESTS = 200_000, 25  # of a load: what a slow link carries in a second or two
MAX_SPACE_BYTES, MAX_SPACE_REQUESTS = 600_000, 8  # of the 3-D view, once it is asked for: three.js, as gzip has it


def test_a_person_flies_by_the_page(tmp_path):
    if shutil.which("node") is None or not (NPM / "node_modules").is_dir():
        pytest.skip("Node.js or the page's packages are missing (./run-tests installs them)")
    if not (NPM.parent / "npm-station" / "node_modules").is_dir():
        pytest.skip("the page is built without its libraries (./run-tests installs them)")
    flight = fly(tmp_path, "--drones", "2", "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    station.wait("tello1", lambda drone: drone["link_phase"] == "on_ground" and drone["position"])
    done = subprocess.run(["node", HERE / "drive.mjs", f"{station.url}/#token={station.token}", tmp_path / "pictures"],
                          env={**os.environ, "LEDGERLINE_PAGE_NPM": str(NPM)}, stdout=subprocess.PIPE, text=True, timeout=400)
    print(done.stdout)
    saw = json.loads(done.stdout)
    assert done.returncode == 0 and not saw["wrong"], saw
    assert saw["console_errors"] == [] and all(not found for found in saw["axe"].values()), saw
    assert saw["bytes"] < MAX_BYTES and saw["requests"] <= MAX_REQUESTS, saw
    assert saw["space"]["bytes"] < MAX_SPACE_BYTES and saw["space"]["requests"] <= MAX_SPACE_REQUESTS, saw
    assert {"Taking off", "By hand", "On its path", "Landed"} <= set(saw["phases"]), saw
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 1, printed(tmp_path)  # it was stopped, and says so
    assert_nothing_left()
