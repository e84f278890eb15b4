"""One organisation enrols as many identities as the ledger takes: it is nobody else's trouble."""
import json
import os
import pathlib
import signal
import subprocess
import time

from flights import BIN, as_user, control, enroll_operator, fly, no_flight_outlives_its_test, pid_of
from station import Station
from test_missions import add, comes_back, mission, until
from test_operators import holder, sign_in
from test_station import end

TRIED, TAKEN = 10_050, 1_024


def begin_without_memory(out: pathlib.Path, station: Station) -> None:
    """Agent and ground, as those that read the ledger for the first time."""
    killed = {program: pid_of(f"ledgerline-{program}") for program in ("agent", "ground")}
    for program, pid in killed.items():
        os.kill(pid, signal.SIGSTOP)  # so that it writes none again
        (out / "run" / "ledger" / f"{program}.checkpoint").unlink()
        os.kill(pid, signal.SIGKILL)
    comes_back(station, killed["ground"])
    assert (out / "run" / "agent.log").read_text().count("there is no checkpoint yet") == 2


def test_an_organisation_full_of_roles_keeps_no_other_from_starting_flying_and_approving(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch", "--operators", "alice,bob", "--approvals", "2")
    station, run = Station(tmp_path, flight), tmp_path / "run"
    station.wait("tello1", lambda drone: drone["link_phase"] == "on_ground")
    control(run / "admin.toml", "grant", "--msp", "Org3MSP", "--stop", "tello1")  # so that all who fly read its roles
    command = [BIN / "test_flood", "--config", as_user(run, 3, "Admin"), "roles", "--identities", str(TRIED)]
    begin = time.monotonic()
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=600)
    did = json.loads(done.stdout.splitlines()[-1])
    print(f"{did} in {time.monotonic() - begin:.1f} s")
    assert did == {"sent": TRIED, "answered": TAKEN, "refused": TRIED - TAKEN}

    begin_without_memory(tmp_path, station)
    alice, bob = sign_in(station, tmp_path, "alice"), sign_in(station, tmp_path, "bob")
    alice.say("drones/tello1/acquire")
    station.wait("tello1", holder("alice"))
    one = add(alice, mission(station, "survey", {"tello1": [(1, 0), (1, 1)]}, "hover"))
    for who in (alice, bob):
        who.say(f"missions/{one}/approve")
    until(alice, one, lambda reported: len(reported["approvals"]) == 2)
    alice.say(f"missions/{one}/start")
    until(alice, one, lambda reported: reported["phase"] == "done")

    # Who is enrolled now in another organisation stops it in the air, at once.
    control(enroll_operator(run, 1, "User2"), "stop", "tello1")
    station.wait("tello1", lambda drone: drone["stopped_by"] and drone["phase"] == "landed")
    end(flight, tmp_path)
