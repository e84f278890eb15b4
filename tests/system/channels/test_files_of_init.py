"""The files that `ledgerline init --profile --channel` writes, as they are: doctor finds nothing wrong, and drones fly by them."""
import json
import os
import pathlib
import shutil
import subprocess
import tomllib

import findings
import pytest
from fabric import BIN
from ledgers import Embedded
from netns import die_with_parent
from running import Failed, Program

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
READY_S, END_S, FLIGHT_S = 60, 30, 240


def init(*words) -> str:
    done = subprocess.run([BIN / "ledgerline", "init", *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


class Network:
    """Channels teleop and yard, an embedded node each, with the same organisations; and what outsiders get of it. That of yard asks
    its clients for a certificate of TLS: the identity's own will do."""

    def __init__(self, directory: pathlib.Path):
        self.directory = directory
        self.teleop = Embedded(directory / "ledger", "--batch-count", "1")
        shutil.copytree(self.teleop.directory / "crypto", directory / "yard" / "crypto")
        authorities = [word for k in (1, 2, 3) for word in ("--tls-client-ca", self.teleop.organisation(k) / f"ca/ca.org{k}.ledgerline-cert.pem")]
        self.yard = Embedded(directory / "yard", "--batch-count", "1", "--channel", "yard", *authorities)
        nodes = {"teleop": self.teleop, "yard": self.yard}
        authority = self.teleop.ca_file(1).read_text()
        self.profile = directory / "profile.json"
        self.profile.write_text(json.dumps({
            "organizations": {f"Org{k}": {"mspid": f"Org{k}MSP", "peers": [f"{name}.org{k}" for name in nodes]} for k in (1, 2, 3)},
            "peers": {f"{name}.org{k}": {"url": f"grpcs://{node.endpoint}", "tlsCACerts": {"pem": authority},
                                         "grpcOptions": {"ssl-target-name-override": "localhost"}}
                      for name, node in nodes.items() for k in (1, 2, 3)},
            "channels": {name: {"peers": {f"{name}.org{k}": {} for k in (1, 2, 3)}} for name in nodes}}))

    def host(self, name: str, role: str, organisation: int, user: str, *drones: str) -> pathlib.Path:
        """A folder as /etc/ledgerline of a host, with what init writes and collects, and nothing else."""
        folder, state = self.directory / name, self.directory / f"{name}-state"
        state.mkdir()
        for node in (self.teleop, self.yard):
            init("--collect", node.directory, "--out", folder)
        msp = self.teleop.msp_dir(organisation, user)
        certificate, key = (next((msp / part).iterdir()) for part in ("signcerts", "keystore"))
        said = init("--role", role, "--profile", self.profile, "--msp-id", f"Org{organisation}MSP", "--out", folder, "--state-dir", state,
                    "--msp-dir", msp, "--tls-certificate", certificate, "--tls-key", key, *(word for drone in drones for word in ("--drone", drone)),
                    "--channel", "yard=tello2")
        assert all(pathlib.Path(file).exists() for file in said.splitlines())
        return folder

    def stop(self) -> None:
        self.teleop.stop()
        self.yard.stop()


@pytest.fixture(scope="module")
def hosts(tmp_path_factory):
    """raven's, ground's and the administrator's."""
    network = Network(tmp_path_factory.mktemp("network"))
    yield (network.host("raven", "drone-host", 1, "User1", "tello1=127.0.0.2", "tello2=127.0.0.3"),
           network.host("ground", "ground", 2, "User1", "tello1", "tello2"),
           network.host("admin", "admin", 1, "Admin", "tello1", "tello2"))
    network.stop()


def test_doctor_finds_nothing_wrong_with_them(hosts):
    for folder, files in zip(hosts, (("agent", "link"), ("ground", "operator", "operator-yard"), ("admin", "admin-yard"))):
        assert sorted(file.stem for file in folder.glob("*.toml")) == sorted(files)
        done = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", folder, "--json"], capture_output=True, text=True, timeout=60)
        assert not [each for each in findings.of_doctor(done).values() if each["verdict"] == "broken"], done.stdout


def test_channel_and_organisations_are_those_of_a_config_block_where_a_profile_names_neither(hosts, tmp_path):
    network = hosts[0].parent
    profile = json.loads((network / "profile.json").read_text())
    del profile["channels"]
    profile["organizations"] = {"Org1": {"mspid": "Org1MSP", "peers": ["yard.org1"]}}  # as those of fabric-samples' test-network
    (tmp_path / "profile.json").write_text(json.dumps(profile))
    msp = next(network.glob("ledger/crypto/peerOrganizations/org1*")) / "users/Admin@org1.ledgerline/msp"
    certificate, key = (next((msp / part).iterdir()) for part in ("signcerts", "keystore"))
    words = ("--role", "bridge", "--profile", tmp_path / "profile.json", "--msp-id", "Org1MSP", "--msp-dir", msp, "--tls-certificate", certificate,
             "--tls-key", key)
    init(*words, "--out", tmp_path / "host", "--state-dir", tmp_path, "--config-block", network / "yard/yard.block")
    config = tomllib.loads((tmp_path / "host/bridge.toml").read_text())
    assert config["ledger"]["channel"] == "yard"
    assert [one["id"] for one in config["msp"]] == ["Org1MSP", "Org2MSP", "Org3MSP"]
    for one in config["msp"]:
        assert pathlib.Path(one["ca"]).read_bytes() == (hosts[0] / "authorities" / f"{one['id']}.pem").read_bytes()
    done = subprocess.run([BIN / "ledgerline", "init", *words, "--out", tmp_path / "other", "--config-block", tmp_path / "profile.json"],
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "profile.json is no block" in done.stderr, done.stderr


def start(folder: pathlib.Path, program: str, *words) -> Program:
    """Ready."""
    started = Program(lambda *command, **to: subprocess.Popen(command, preexec_fn=die_with_parent, **to),
                      [BIN / f"ledgerline-{program}", *words], folder / f"{program}.log")
    try:
        started.wait_ready(READY_S)
    except Failed:
        started.end(END_S)
        raise
    return started


@pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1")
def test_drones_of_two_channels_fly_by_them(hosts, tmp_path):
    raven, ground_host, admin = hosts
    for channel, drone in (("", "tello1"), ("-yard", "tello2")):
        shown = subprocess.run([BIN / "ledgerline", "control", "--config", admin / f"admin{channel}.toml", "show"], capture_output=True,
                               text=True, timeout=60)
        assert shown.returncode == 0 and drone in shown.stdout, shown.stderr
        subprocess.run([BIN / "ledgerline", "control", "--config", ground_host / f"operator{channel}.toml", "acquire", drone], check=True, timeout=60)
    programs = []
    try:
        for words in (("roudi",), ("sim", "--drones", "2"), ("link", "--config", raven / "link.toml"), ("agent", "--config", raven / "agent.toml")):
            programs.append(start(tmp_path, *words))
        config = ground_host / "ground.toml"
        config.write_text(config.read_text().replace('shape = "manual"', 'shape = "square"'))
        ground = subprocess.run([BIN / "ledgerline-ground", "--config", config], capture_output=True, text=True,
                                timeout=FLIGHT_S)
        assert ground.returncode == 0, ground.stderr[-3000:] + (tmp_path / "agent.log").read_text()[-2000:]
    finally:
        for program in reversed(programs):
            assert program.end(END_S) is not None, f"{program.log.stem} had to be killed"
    last = json.loads([line for line in ground.stdout.splitlines() if line.startswith('{"ground"')][-1])["ground"]["drones"]
    assert [(one["name"], one["channel"], one["phase"]) for one in last] == [("tello1", "teleop", "landed"), ("tello2", "yard", "landed")], last
