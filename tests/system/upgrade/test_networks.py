"""A network of the version before gets today's contract: while it is down, and one on three hosts while it serves."""
import json
import pathlib
import shutil
import subprocess

from before import Before
from fabric import BIN, FABRIC, TIMEOUT_S, Network, Peer, fabric, needs_fabric
from official import ENDORSEMENT_POLICY_FAILURE, VALID, encode
from three_hosts import HOSTS, make_hosts, network_config


def definition(peer: Peer) -> dict:
    done = peer.run("lifecycle", "chaincode", "querycommitted", "--channelID", "teleop", "--name", "ledgerline", "--output", "json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_network_that_was_down_comes_up_with_todays_contract(tmp_path, members):
    needs_fabric()
    before, directory = Before(tmp_path), tmp_path / "net"
    network = Network(directory, command=before.command).wait_ready()
    admin = Peer(directory, network.ready["endpoint"], 1, network.ready["orderers"][0], user="Admin")
    old = definition(admin)
    who = members(directory)
    who(2, "User1").submit("acquire", {"drones": ["tello1"]})
    assert who.forge([{"key": "grant/tello2", "value": encode("")}, {"key": "free/before", "value": encode("x")}], 3) == VALID
    network.stop()
    before.update(directory)
    network = Network(directory).wait_ready()
    new = definition(admin)
    assert (old["sequence"], new["sequence"]) == (1, 2) and old["version"] != new["version"]
    assert old["validation_parameter"] != new["validation_parameter"]
    who = members(directory)
    assert who.forge([{"key": "free/after", "value": encode("x")}], 3) == ENDORSEMENT_POLICY_FAILURE
    who(2, "User1").submit("release", {"drones": ["tello1"]})
    assert who.forge([{"key": "control/tello1", "value": encode("x")}], 2, 3) == ENDORSEMENT_POLICY_FAILURE
    network.stop()


def test_three_hosts_bring_their_parts_one_after_the_other(tmp_path):
    needs_fabric()
    config = network_config(tmp_path)
    made = fabric("identities", "--config", config, "--dir", tmp_path / "made", "--tools", FABRIC)
    assert made.returncode == 0, made.stderr
    spaces, before, networks = make_hosts(), [], []
    try:
        for k, space in enumerate(spaces, 1):
            home = tmp_path / f"home{k}"
            home.mkdir()
            before.append(Before(home))
            shutil.copytree(tmp_path / "made" / f"host-{HOSTS[k]}", home / "net")
            networks.append(Network(home / "net", "--config", config, "--only", f"org{k}", "--only", f"orderer{k}",
                                    command=lambda *words, k=k: spaces[k - 1].command(*before[k - 1].command(*words))))
        readies = [network.wait_ready().ready for network in networks]
        admins = [Peer(network.directory, ready["endpoint"], k, f"{HOSTS[k]}:7061", user="Admin", command=space.command)
                  for k, (space, network, ready) in enumerate(zip(spaces, networks, readies), 1)]
        assert [definition(admin)["sequence"] for admin in admins] == [1, 1, 1]
        for one, network in zip(before, networks):
            one.update(network.directory)
        # The host of Org1 as the last: the others wait for it.
        upgrades = [subprocess.Popen(spaces[k].command(before[k].fabric, "fabric", "upgrade", "--dir", networks[k].directory, "--tools", FABRIC),
                                     stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) for k in (2, 1, 0)]
        for upgrade in upgrades:
            said, _ = upgrade.communicate(timeout=TIMEOUT_S)
            assert upgrade.returncode == 0, said
        assert [definition(admin)["sequence"] for admin in admins] == [2, 2, 2]
        for k, (space, network, ready) in enumerate(zip(spaces, networks, readies), 1):
            peer = Peer(network.directory, ready["endpoint"], k, f"{HOSTS[k]}:7061", command=space.command, peers=ready["peers"])
            peer.invoke("teleop", "set", json.dumps({"id": f"Org{k}MSP/note", "msgType": "by today's contract"}))
            assert programs_of(network.directory, f"chaincode{k}") == (BIN / "ledgerline-chaincode").resolve()
        for network in networks:
            network.stop()
    finally:
        for network in networks:
            network.process.kill()
        for space in spaces:
            space.close()


def programs_of(directory: pathlib.Path, name: str) -> pathlib.Path:
    process = next(one for one in json.loads((directory / "network.json").read_text())["processes"] if one["name"] == name)
    return pathlib.Path(f"/proc/{process['pid']}/exe").readlink()
