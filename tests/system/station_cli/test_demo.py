"""`ledgerline demo`, from the build tree and from an installed one."""
import os
import pathlib
import re
import signal
import subprocess
import urllib.request

from flights import BIN, assert_nothing_left, no_flight_outlives_its_test, printed, started
from station import Station


def demo(program: pathlib.Path, out: pathlib.Path, *options: str, path: str = "") -> tuple[subprocess.Popen, Station]:
    out.mkdir(exist_ok=True)
    with open(out / "fly.out", "wb") as log:
        environment = {key: value for key, value in os.environ.items() if key != "LEDGERLINE_BIN"}
        started.append(subprocess.Popen([program, "demo", "--out", out / "run", *options], stdout=log, stderr=subprocess.STDOUT,
                                        env=environment | {"PATH": path + os.environ["PATH"]}))
    return started[-1], Station(out, started[-1])


def check_and_end(flight: subprocess.Popen, station: Station, out: pathlib.Path) -> None:
    with urllib.request.urlopen(station.url, timeout=60) as page:
        assert page.status == 200 and b"<html" in page.read().lower()
    assert [drone["name"] for drone in station.ask("GET", "drones")[1]["drones"]] == ["tello1", "tello2", "tello3"]
    assert {one["name"] for one in station.ask("GET", "operators")[1]["operators"]} == {"alice", "bob"}
    reported = printed(out)
    assert re.search(r"Operator alice: pass phrase \w+", reported) and re.search(r"Operator bob: pass phrase \w+", reported)
    assert f"export LEDGERLINE_STATION={station.url} LEDGERLINE_TOKEN_FILE={out}/run/page.token" in reported
    mission = pathlib.Path(re.search(r"\S+/mission-two\.csv", reported)[0])
    assert mission.read_text().count("tello1") > 1
    station.wait("tello3", lambda drone: drone["link_phase"] == "on_ground")
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, reported


def test_the_demo_says_where_to_click_and_ends_with_nothing_left(tmp_path):
    browser = tmp_path / "browser"
    browser.mkdir()
    (browser / "xdg-open").write_text(f"#!/bin/sh\necho \"$*\" > {browser}/asked\n")
    (browser / "xdg-open").chmod(0o755)
    flight, station = demo(BIN / "ledgerline", tmp_path, "--open", path=f"{browser}:")
    second = subprocess.run([BIN / "ledgerline", "demo"], capture_output=True, text=True, timeout=60)
    assert second.returncode == 1 and "a flight is already in progress" in second.stderr and second.stdout == "", second
    check_and_end(flight, station, tmp_path)
    asked = (browser / "asked").read_text().strip()
    assert asked == f"{tmp_path}/run/open.html" and station.token in pathlib.Path(asked).read_text()
    assert_nothing_left()


def test_an_installed_demo_needs_no_build_tree(tmp_path):
    for part in ("common", "onboard", "ground", "ledger", "tools"):
        subprocess.run(["cmake", "--install", BIN.parent, "--component", part, "--prefix", tmp_path / "usr"], check=True, capture_output=True)
    flight, station = demo(tmp_path / "usr/bin/ledgerline", tmp_path)
    check_and_end(flight, station, tmp_path)
    assert str(tmp_path / "usr/share/ledgerline/examples/mission-two.csv") in printed(tmp_path)
    left = [exe for exe in pathlib.Path("/proc").glob("[0-9]*/exe") if link_of(exe).startswith(str(tmp_path / "usr"))]
    assert left == []


def link_of(exe: pathlib.Path) -> str:
    try:
        return os.readlink(exe)
    except OSError:
        return ""
