"""An organisation's own endorser beside its peer: the same answers, and flights that outlive it."""
import json
import os
import pathlib
import signal
import subprocess
import time

import pytest
from endorsers import Endorser
from fabric import BIN, FABRIC, TIMEOUT_S, needs_fabric
from flights import fly, no_flight_outlives_its_test, pid_of, printed, wait_for_flight
from ledgers import CUTTING, Authority, Fabric, tables
from netns import die_with_parent
from random_proposals import ask_random_proposals
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
COUNT = 10_000 if LONG else 500


def status_of(ledger, directory: pathlib.Path, endorser: Endorser) -> list[dict]:
    """The peers that `ledgerline status` tells of who has the endorser in front of its peer."""
    folder = directory / "status"
    folder.mkdir()
    config = folder / "operator.toml"
    config.write_text(tables(ledger, 1, "User1").split("[[msp]]")[0] +
                      f'[[endorser]]\nmsp_id = "Org1MSP"\nendpoint = "{endorser.endpoint}"\ntls_ca = "{ledger.ca_file(1)}"\n')
    said = subprocess.run([BIN / "ledgerline", "status", "--config-dir", folder, "--json"], capture_output=True, text=True, timeout=TIMEOUT_S)
    return next(one["peers"] for one in json.loads(said.stdout)["ledgers"] if one["config"] == str(config))


def test_random_proposals_are_answered_byte_for_byte_as_by_the_peer(network, tmp_path):
    endorser = Endorser(network, tmp_path, "check_one_in = 10\n")
    peer, own = status_of(network, tmp_path, endorser)
    assert peer["height"] > 1 and not peer["endorser"], peer
    assert own == {"endpoint": endorser.endpoint, "msp_id": "Org1MSP", "height": None, "endorser": True, "why": None}, "it is no peer that fails"
    said = ask_random_proposals(network, tmp_path, endorser, COUNT)
    print(json.dumps(said, indent=1))
    assert said["differ"] == 0, said["first_difference"]
    assert said["committed"] > COUNT / 50 and said["invalid"] == 0
    kinds = said["kinds"]
    assert {kind: 20 * reported["asked"] / COUNT for kind, reported in kinds.items()} == {
        "good command": 6, "good state": 2, "any call": 6, "used id": 2, "wrong creator": 2, "expired creator": 2}
    assert kinds["good command"]["endorsed"] >= COUNT / 5, "most of what is flown is commands that are good"
    assert kinds["good state"]["endorsed"] == kinds["good state"]["asked"]
    assert kinds["any call"]["refused"] > COUNT / 10 and len(said["same"]) > 12
    for kind in ("used id", "wrong creator", "expired creator"):
        assert kinds[kind]["unanswered"] == kinds[kind]["asked"], said["words"]
    assert set(said["left_to_the_peer"]) <= {"get", "verify"}, "nothing else looks into old blocks"
    counts = endorser.stop()
    assert counts["differ"] == 0 and counts["same"] > 0, counts
    # It starts again from nothing but the chain.
    again = Endorser(network, tmp_path)
    assert again.stop()["blocks"] == counts["blocks"]


@pytest.fixture(params=["own", "fabric-ca"])
def network_of(request, tmp_path):
    needs_fabric()
    if request.param == "fabric-ca" and not (FABRIC / "fabric-ca-server").exists():
        pytest.skip("scripts/fabric-tools --ca builds fabric-ca")
    ledger = Fabric(tmp_path / "network", *CUTTING, *(["--ca"] if request.param == "fabric-ca" else []))
    yield request.param, ledger
    assert ledger.stop() == 0, ledger.log()


def test_a_stolen_key_of_an_endorser_ends_with_a_revocation_list(network_of, tmp_path):
    authority, network = network_of
    stolen = network.organisation(1) / "peers" / "endorser0.org1.ledgerline" / "msp"
    host, admin = tmp_path / "host.toml", tmp_path / "admin.toml"
    for file, user in ((host, "User1"), (admin, "Admin")):
        file.write_text(tables(network, 1, user, endorsers=True).split("[[msp]]")[0])
    orderer, orderer_ca = network.orderer()
    thief = subprocess.Popen([BIN / "test_stolen_key", "--host", host, "--admin", admin, "--stolen", stolen, "--orderer", orderer,
                              "--orderer-ca", orderer_ca], stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent)
    assert json.loads(thief.stdout.readline())["valid"] == 20

    def revoke(*which) -> subprocess.CompletedProcess:
        return subprocess.run([BIN / "ledgerline", "fabric", "revoke", "--dir", network.directory, "--tools", FABRIC, "--org", "1", *which],
                              capture_output=True, text=True, timeout=TIMEOUT_S)

    which = ["--user", "endorser0"]
    if authority == "own":
        certificate, own = next((stolen / "signcerts").iterdir()), Authority(network, 1, tmp_path / "authority")
        listed = tmp_path / "revoked.pem"
        listed.write_text(own.revoke(certificate, names_key=False))
        unnamed = revoke("--list", listed)
        assert unnamed.returncode == 1 and "authority key identifier" in unnamed.stderr, "it would lock the organisation out"
    began_ns = time.monotonic_ns()
    if authority == "own":
        listed.write_text(own.revoke(certificate))
        which = ["--list", listed]
    revoked = revoke(*which)
    known_ns = time.monotonic_ns()
    assert revoked.returncode == 0, revoked.stderr
    said = json.loads(thief.stdout.readline())
    assert thief.wait(timeout=TIMEOUT_S) == 0
    print(json.dumps({"authority": authority, "first invalid after, s": round((said["at_ns"] - began_ns) / 1e9, 3),
                      "every peer knows after, s": round((known_ns - began_ns) / 1e9, 3)} | said))
    assert said["code"] == 10 and said["later"] == [10] * 5, "its endorsements count no more, from that block on"


def test_a_flight_is_endorsed_within_agent(tmp_path):
    needs_fabric()
    flight = fly(tmp_path, "--drones", "1", "--seconds", "5", "--ledger", "fabric", "--endorser-within", "--blocks", "ordered")
    flight.wait(120)
    run = tmp_path / "run"
    agent, counts = (json.loads((run / f"{name}.summary.json").read_text()) for name in ("agent", "endorser"))
    print(json.dumps(counts))
    assert agent["integrity_violations"] == 0 and counts["differ"] == 0 and counts["apart"] == 0
    assert counts["same"] > 0 and counts["joined"], "it lives on agent's own stream"
    assert counts["answered"] > 200, "five seconds of thirty states and as many commands"
    key = next((run / "ledger/crypto/peerOrganizations/org1.ledgerline/peers/endorser0.org1.ledgerline/msp/keystore").iterdir())
    assert key.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP] if LONG else [signal.SIGKILL], ids=lambda how: how.name)
def test_a_flight_goes_on_over_the_peer_without_its_endorser(tmp_path, how):
    needs_fabric()
    flight = fly(tmp_path, "--drones", "1", "--seconds", "8", "--ledger", "fabric", "--endorser")
    wait_for_flight(tmp_path, flight)
    time.sleep(2)
    endorser = pid_of("ledgerline-endorser")
    since_ns = time.monotonic_ns()
    os.kill(endorser, how)
    time.sleep(4)
    if how == signal.SIGSTOP:
        os.kill(endorser, signal.SIGCONT)
    flight.wait(120)
    if how == signal.SIGKILL:
        assert "the peer endorses in its place" in printed(tmp_path), printed(tmp_path)
    agent = json.loads((tmp_path / "run" / "agent.summary.json").read_text())
    assert agent["integrity_violations"] == 0
    commands_s = [(r.t_ns - since_ns) / 1e9 for r in records(tmp_path / "run" / "agent.trace")
                  if r.kind == TraceKind.COMMAND_VERIFIED and r.t_ns > since_ns]
    max_s = max(after - before for before, after in zip([0, *commands_s], commands_s))
    print(json.dumps({"how": how.name, "commands": len(commands_s), "maximum gap, s": round(max_s, 3)}))
    assert len([s for s in commands_s if 1 < s < 4]) > 30, "30 states a second are answered"
