"""The real agent and ledger over the shim, and another simulator than ours behind it."""
import json
import subprocess
import time

import flights
from flights import no_flight_outlives_its_test  # noqa: F401: for each test
from shim import BIN, SHARED_MEMORY, link_config, ready, running


def test_a_flight_with_agent_and_ledger_that_the_shim_impairs(tmp_path):
    out = tmp_path / "flight"
    flight = flights.fly(out, "--shim", "--seconds", "6", "--seed", "3")
    socket = out / "run" / "shim.sock"
    until = time.monotonic() + 60
    while not socket.exists():
        assert flight.poll() is None and time.monotonic() < until, flights.printed(out)
        time.sleep(0.05)
    for command in ("sdk tello1 answers late 200ms", "sdk tello1 states stale 20%", "list"):
        said = subprocess.run([BIN / "ledgerline", "hil", "faults", socket, command], capture_output=True, text=True, timeout=30)
        assert said.returncode == 0, said.stderr
    assert "sdk tello1 answers late 200ms" in said.stdout
    refused = subprocess.run([BIN / "ledgerline", "hil", "faults", socket, "server agent cut"], capture_output=True, text=True, timeout=30)
    assert refused.returncode == 1 and "no such server" in refused.stderr
    assert flight.wait(180) == 0, flights.printed(out)
    assert 'transport = "shim"' in (out / "run" / "link.toml").read_text()
    result = flights.result(out)
    assert result["ok"], result
    assert not list(SHARED_MEMORY.glob("ledgerline-*.shim"))


def test_a_fault_script_is_checked(tmp_path):
    script = tmp_path / "takeoff-late.toml"
    script.write_text('title = "Its take-off is answered late, and its state is torn: it flies"\nmust = ["finishes"]\n[flight]\nside_m = 0.6\n'
                      '[[fault]]\nwhat = "sdk tello1 answers late 500ms"\nat = "0s"\n'
                      '[[fault]]\nwhat = "sdk tello1 states torn 20%"\nfor = "2s"\n')
    refused = subprocess.run([BIN / "ledgerline", "fault", "run", script, "--real", "--out", tmp_path / "udp"], capture_output=True, text=True, timeout=60)
    assert refused.returncode == 2 and "--shim" in refused.stderr
    done = subprocess.run([BIN / "ledgerline", "fault", "run", script, "--real", "--shim", "--out", tmp_path / "out"], capture_output=True, text=True,
                          timeout=200)
    assert done.returncode == 0, done.stdout + done.stderr


def test_another_simulator_is_flown(tmp_path):
    memory = SHARED_MEMORY / "mine"
    log = tmp_path / "example.log"
    with running(log, BIN / "drone_shim_example", memory, 1) as example:
        assert example.stdout.readline() == "ready\n"
        roudi_log, link_log = tmp_path / "roudi.log", tmp_path / "link.log"
        with running(roudi_log, BIN / "ledgerline-roudi") as roudi:
            ready(roudi, roudi_log)
            config = link_config(tmp_path, 1, memory, False)
            config.write_text(config.read_text() + "status_period_ms = 100\n")
            with running(link_log, BIN / "ledgerline-link", "--config", config) as link:
                ready(link, link_log)
                until = time.monotonic() + 30
                # Its state text has come through, so its answer to `command` has, too: before, link asks for none.
                while abs(json.loads(link.stdout.readline())["link"]["drones"][0]["battery"] - 0.9) > 0.01:
                    assert link.poll() is None and time.monotonic() < until, link_log.read_text()
                link.terminate()
                assert link.wait(30) == 0, link_log.read_text()
