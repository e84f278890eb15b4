"""Two channels: drones of two organisations, an agent and a ground on both, and what each may."""
import json
import os
import pathlib
import shutil
import subprocess

import pytest
from drone_host import Drone, Host
from fabric import BIN, needs_fabric
from ledgers import Embedded, Fabric, tables

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
PATIENCE_S = 120


class Ledgers:
    """Channels teleop and yard of the same three organisations: of one network, or of an embedded node each."""

    def __init__(self, directory: pathlib.Path, fabric: bool):
        if fabric:
            self.teleop = self.yard = Fabric(directory / "ledger", "--channel", "teleop", "--channel", "yard")
        else:
            self.teleop = Embedded(directory / "ledger", "--batch-count", "1")
            shutil.copytree(self.teleop.directory / "crypto", directory / "yard" / "crypto")
            self.yard = Embedded(directory / "yard", "--batch-count", "1", "--channel", "yard")
        self.all = list({id(one): one for one in (self.teleop, self.yard)}.values())

    def tables(self, organisation: int, user: str = "User1") -> str:
        """Of a program on both."""
        text = f'[[channel]]\nname = "yard"\nconfig_block = "{self.yard.directory}/yard.block"\n'
        if self.yard is not self.teleop:
            text += 'endpoint = "{}"\ntls_ca = "{}"\n'.format(*self.yard.peer(organisation))
        return tables(self.teleop, organisation, user, endorsers=True) + text

    def yard_tables(self, organisation: int, user: str = "User1") -> str:
        """Of a program on yard alone."""
        text = tables(self.yard, organisation, user, endorsers=True).replace("teleop.block", "yard.block")
        return text.replace("[ledger]\n", '[ledger]\nchannel = "yard"\n')

    def stop(self) -> None:
        for one in self.all:
            one.stop()


@pytest.fixture(params=["embedded", "fabric"] if LONG else ["embedded"])
def ledgers(request, tmp_path):
    if request.param == "fabric":
        needs_fabric()
    made = Ledgers(tmp_path, request.param == "fabric")
    yield made
    made.stop()


def test_each_organisation_flies_its_own_drones_on_two_channels(tmp_path, ledgers):
    def control(channel: str, organisation: int, user: str, *words) -> subprocess.CompletedProcess:
        file = tmp_path / f"control-{channel}-{organisation}-{user}.toml"
        text = ledgers.yard_tables(organisation, user) if channel == "yard" else tables(ledgers.teleop, organisation, user, endorsers=True)
        file.write_text(text.split("[[msp]]")[0])
        return subprocess.run([BIN / "ledgerline-control", "--config", file, *words], capture_output=True, text=True, timeout=60)

    def done(*words) -> str:
        ended = control(*words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    def refused(*words) -> str:
        ended = control(*words)
        assert ended.returncode != 0, ended.stdout
        return ended.stderr

    def cert(organisation: int, user: str) -> pathlib.Path:
        return next((ledgers.teleop.msp_dir(organisation, user) / "signcerts").iterdir())

    # tello1 and tello2 are Org1's on either channel; south is Org2's, on yard alone.
    for channel in ("teleop", "yard"):
        done(channel, 1, "Admin", "enroll", "--msp", "Org1MSP", "--cert", cert(1, "User2"), "--role", "operator")
    done("yard", 2, "Admin", "enroll", "--msp", "Org2MSP", "--cert", cert(2, "User1"), "south")
    done("yard", 2, "Admin", "enroll", "--msp", "Org2MSP", "--cert", cert(2, "User2"), "--role", "operator")
    done("teleop", 1, "User2", "acquire", "tello1")
    done("yard", 1, "User2", "acquire", "tello2")
    done("yard", 2, "User2", "acquire", "south")
    assert "grant" in refused("yard", 1, "User2", "acquire", "south")
    assert "enrolled" in refused("teleop", 1, "User2", "acquire", "south"), "a channel knows its own drones alone"

    hosts = [Host(tmp_path / "host1", ledgers.all, ledgers.tables(1), [Drone("tello1", 1), Drone("tello2", 2, "yard")]),
             Host(tmp_path / "host2", [ledgers.yard], ledgers.yard_tables(2), [Drone("south", 1)], pose="tello1")]
    one_lap = lambda name: (f'[output]\nsummary = "{tmp_path}/{name}.json"\nstatus_period_ms = 0\n[flight]\nlaps = 1\nside_m = 1\n'
                            "[dds]\nlocal_only = true\n")
    (tmp_path / "ground1.toml").write_text(ledgers.tables(1, "User2") + one_lap("ground1") +
                                           '[[drone]]\nname = "tello1"\n[[drone]]\nname = "tello2"\nchannel = "yard"\n')
    (tmp_path / "ground2.toml").write_text(ledgers.yard_tables(2, "User2") + one_lap("ground2") + '[[drone]]\nname = "south"\n')
    try:
        grounds = [subprocess.Popen([BIN / "ledgerline-ground", "--config", tmp_path / f"ground{k}.toml"], text=True,
                                    stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) for k in (1, 2)]
        for ground in grounds:
            said = ground.communicate(timeout=PATIENCE_S)[1]
            assert ground.returncode == 0, said[-3000:] + "".join(host.log() for host in hosts)
    finally:
        for ground in grounds:
            ground.kill()
        for host in hosts:
            host.stop()
    on_both = json.loads((tmp_path / "host1" / "agent.json").read_text())["channels"]
    of_south = json.loads((tmp_path / "host2" / "agent.json").read_text())
    assert [(one["channel"], [drone["name"] for drone in one["drones"]]) for one in (*on_both, of_south)] == [
        ("teleop", ["tello1"]), ("yard", ["tello2"]), ("yard", ["south"])]
    for one in (*on_both, of_south):
        commands = one["drones"][0]["commands"]
        assert commands["on_ledger"] > 50 and commands["verified"] > 0.9 * commands["on_ledger"], commands
        assert one["doubts"] == 0 and one["drones"][0]["states"]["on_ledger"] > 50, one
