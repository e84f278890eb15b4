"""One operator's mission with drones of two organisations: a host each, whose network and shared memory are its own."""
import json
import os
import pathlib
import re
import subprocess

import pytest
from drone_host import Drone, Host
from fabric import BIN, needs_fabric
from ledgers import Embedded, Fabric, tables

LONG = os.environ.get("LEDGERLINE_LONG") == "1"

TIMEOUT_S = 120
OPERATOR = 2  # the organisation


@pytest.fixture(params=["embedded", "fabric"] if LONG else ["fabric"])
def ledger(request, tmp_path):
    if request.param == "fabric":
        needs_fabric()
    made = Embedded(tmp_path / "ledger", "--batch-count", "1") if request.param == "embedded" else Fabric(tmp_path / "ledger")
    yield made
    made.stop()


def test_an_operator_flies_drones_of_two_other_organisations_in_one_mission(tmp_path, ledger):
    def control(organisation: int, user: str, *words) -> None:
        file = tmp_path / f"control{organisation}{user}.toml"
        file.write_text(tables(ledger, organisation, user, endorsers=True).split("[[msp]]")[0])
        done = subprocess.run([BIN / "ledgerline", "control", "--config", file, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr

    def cert(organisation: int) -> pathlib.Path:
        return next((ledger.msp_dir(organisation, "User1") / "signcerts").iterdir())

    drones = {1: "north", 3: "south"}
    for owner, drone in drones.items():
        control(owner, "Admin", "enroll", "--msp", f"Org{owner}MSP", "--cert", cert(owner), drone)
        control(owner, "Admin", "grant", "--msp", f"Org{OPERATOR}MSP", "--fly", "--max-priority", "10", drone)
    control(OPERATOR, "Admin", "enroll", "--msp", f"Org{OPERATOR}MSP", "--cert", cert(OPERATOR), "--role", "operator")
    control(OPERATOR, "User1", "acquire", *drones.values())  # of two owners in one transaction
    hosts = [Host(tmp_path / f"host{owner}", [ledger], tables(ledger, owner, endorsers=True), [Drone(drone, number)], pose="tello1")
             for number, (owner, drone) in enumerate(drones.items(), 1)]
    try:
        (tmp_path / "ground.toml").write_text(
            f'{tables(ledger, OPERATOR, endorsers=True)}[output]\nsummary = "{tmp_path}/ground.json"\nstatus_period_ms = 0\n'
            "[flight]\nlaps = 1\n[dds]\nlocal_only = true\n" +
            "".join(f'[[drone]]\nname = "{drone}"\n' for drone in drones.values()))
        flown = subprocess.run([BIN / "ledgerline-ground", "--config", tmp_path / "ground.toml"], capture_output=True,
                               text=True, timeout=TIMEOUT_S)
        assert flown.returncode == 0, flown.stderr[-3000:] + "".join(host.log() for host in hosts)
    finally:
        for host in hosts:
            host.stop()
    ground = json.loads((tmp_path / "ground.json").read_text())
    assert all(drone["finished"] and drone["landed"] for drone in ground["drones"]), ground
    assert ground["transactions_altered"] == ground["states_unverified"] == 0
    print({key: ground["transactions"][key] for key in ("submitted", "committed", "invalidated")})
    for host in hosts:
        agent = json.loads((host.directory / "agent.json").read_text())
        commands = agent["drones"][0]["commands"]
        assert commands["on_ledger"] > 100 and commands["verified"] > 0.9 * commands["on_ledger"], commands

    config = (tmp_path / "ground.toml").read_text()
    early = re.sub(r'\nendpoint = ".*"', '\nendpoint = "127.0.0.1:9"', config, count=1)
    manual = early.replace("[flight]\nlaps = 1\n", '[flight]\nshape = "manual"\n')
    for text, code in ((manual, 3), (early, 1)):  # ledgerline-ground.service starts the first one again
        (tmp_path / "early.toml").write_text(text)
        ended = subprocess.run([BIN / "ledgerline-ground", "--config", tmp_path / "early.toml"], capture_output=True, text=True,
                               timeout=TIMEOUT_S)
        assert ended.returncode == code
        assert "gave up after 15 s waiting until the ledger's blocks can be read" in ended.stderr, ended.stderr
