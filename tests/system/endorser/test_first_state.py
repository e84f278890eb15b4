"""An own endorser that begins behind a snapshot of Fabric's peer, in place of the whole chain. All of it is of the long run."""
import json
import os
import pathlib
import shutil
import subprocess
import time

import pytest
from endorsers import Endorser, write_config
from fabric import BIN, TIMEOUT_S, Peer
from random_proposals import ask_random_proposals

pytestmark = pytest.mark.skipif(os.environ.get("LEDGERLINE_LONG") != "1", reason="LEDGERLINE_LONG=1 runs it")
COUNT = 1_000


def newest_block(network, organisation: int) -> int:
    peer = Peer(network.directory, network.ready["peers"][organisation - 1], organisation, network.ready["orderers"][0], "Admin")
    said = peer.run("channel", "getinfo", "-c", "teleop")
    assert said.returncode == 0, said.stderr
    return json.loads(said.stdout.split("Blockchain info: ")[1])["height"] - 1


def make_snapshot(network, organisation: int, number: int) -> pathlib.Path:
    """As the peer itself makes it, of its newest block."""
    address = network.ready["peers"][organisation - 1]
    peer = Peer(network.directory, address, organisation, network.ready["orderers"][0], "Admin")
    asked = peer.run("snapshot", "submitrequest", "-c", "teleop", "-b", number, "--peerAddress", address, "--tlsRootCertFile",
                     network.ca_file(organisation))
    assert asked.returncode == 0, asked.stderr
    folder = network.directory / f"peer{organisation}" / "snapshots" / "completed" / "teleop" / str(number)
    deadline = time.monotonic() + TIMEOUT_S
    while not folder.exists():
        assert time.monotonic() < deadline, "the peer makes no snapshot"
        time.sleep(0.1)
    return folder


def hash_of(snapshot: pathlib.Path) -> str:
    return json.loads((snapshot / "_snapshot_additional_metadata.json").read_text())["snapshot_hash"]


def refused(network, directory: pathlib.Path, start: str) -> str:
    done = subprocess.run([BIN / "ledgerline-endorser", write_config(network, directory, f"[start]\n{start}")], capture_output=True,
                          text=True, timeout=TIMEOUT_S)
    assert done.returncode == 2 and not done.stdout, done.stdout + done.stderr
    return done.stderr


def test_behind_a_peers_snapshot_random_proposals_are_answered_byte_for_byte_as_by_the_peer(network, tmp_path):
    # What is to be in the snapshot: keys of all kinds, most with policies of their own, some deleted; used ids.
    whole = Endorser(network, tmp_path / "whole")
    ask_random_proposals(network, tmp_path, whole, COUNT)
    whole.stop()
    last = newest_block(network, 1)
    deadline = time.monotonic() + TIMEOUT_S
    while newest_block(network, 2) < last:
        assert time.monotonic() < deadline
    snapshot, second = make_snapshot(network, 1, last), make_snapshot(network, 2, last)
    assert hash_of(snapshot) == hash_of(second), "two organisations' peers make the same of the same blocks"

    start = f'first_state = "{snapshot}"\nfirst_state_hash = "{hash_of(second)}"\n'
    began = time.monotonic()
    endorser = Endorser(network, tmp_path / "behind", f'check_one_in = 10\n[start]\n{start}')
    ready_s = time.monotonic() - began
    said = ask_random_proposals(network, tmp_path, endorser, COUNT, "--again", "--seed", "2")
    counts = endorser.stop()
    print(json.dumps({"ready, s": round(ready_s, 3), "snapshot of block": last, "summary": counts}))
    print(json.dumps(said, indent=1))
    assert said["differ"] == 0, said["first_difference"]
    assert said["invalid"] == 0 and said["committed"] > COUNT / 50
    kinds = said["kinds"]
    for kind in ("used id", "wrong creator", "expired creator"):
        assert kinds[kind]["unanswered"] == kinds[kind]["asked"], said["words"]
    assert kinds["good command"]["endorsed"] >= COUNT / 5
    assert kinds["good state"]["endorsed"] == kinds["good state"]["asked"]
    assert set(said["left_to_the_peer"]) <= {"get", "verify"}
    assert counts["restored"] == last + 1 < counts["blocks"], "it read the blocks behind the snapshot alone"
    assert counts["differ"] == 0 and counts["apart"] == 0 and counts["same"] > 0, counts

    # One value is another one: by the hashes it is refused, and nobody reads the chain in its place.
    forged = tmp_path / "forged"
    shutil.copytree(snapshot, forged)
    states = bytearray((forged / "public_state.data").read_bytes())
    states[len(states) // 2] ^= 1
    (forged / "public_state.data").write_bytes(states)
    assert "public_state.data: its SHA-256 is not" in refused(network, tmp_path / "forged-start", f'first_state = "{forged}"\n')
    said = refused(network, tmp_path / "foreign", f'first_state = "{snapshot}"\nfirst_state_hash = "{"0" * 64}"\n')
    assert "it is another snapshot" in said and "peer snapshot submitrequest" in said
