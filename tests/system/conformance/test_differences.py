"""Where the embedded node answers otherwise than Fabric, and means to: the table in docs/ledger.md. Each line of it is
looked at on both, so that it stays true."""
import time

import pytest
from official import ABORTED, BAD_REQUEST, PERMISSION_DENIED, SUCCESS, VALID, Client, asset, call


@pytest.fixture
def fabric(ledger) -> bool:
    return ledger.name == "fabric"


def test_an_id_that_somebody_has_claimed(fabric, drone_host, operator):
    """The thief's transaction is no valid one; still Fabric's peers take its id for used."""
    claimed = drone_host.call("stolen", "set", asset("tello1/mine"), thief=operator.identity,
                              theft=call("get"))
    if fabric:
        assert "duplicate transaction found" in claimed["error"]["details"][0]
    else:
        assert claimed["code"] == VALID


def test_an_expired_certificate_at_the_gateway(fabric, node, drone_host, authority):
    """It writes nothing on either ledger (test_identities.py); Fabric's gateway still lets it read."""
    former = Client(node, authority.issue("Reader", authority.begin() + 1, time.time() - 1))
    tx = drone_host.submit("set", asset("tello1/read"))["tx"]
    if fabric:
        assert former.read("get", "tello1/read")["id"] == "tello1/read"
        assert former.ask("status", tx=tx)["code"] == VALID
        assert len(former.ask("events", start=0, count=1)["events"]) == 1
    else:
        endorse = former.call("endorse", "get", "tello1/read")["error"]
        assert endorse["code"] == ABORTED and "has expired" in endorse["details"][0]
        assert "has expired" in former.call("evaluate", "get", "tello1/read")["error"]["message"]
        assert former.ask("status", tx=tx)["error"]["code"] == PERMISSION_DENIED
        assert former.ask("events", start=0, count=1)["error"]["code"] == PERMISSION_DENIED


def test_a_certificate_that_is_not_valid_yet(fabric, node, authority):
    now = time.time()
    early = Client(node, authority.issue("Early", now + 3600, now + 7200))
    answer = early.call("submit", "set", asset("Org1MSP/early"))
    if fabric:
        assert answer["code"] == VALID
    else:
        assert answer["error"]["code"] == ABORTED and "is not yet valid" in answer["error"]["details"][0]


def test_an_envelope_that_is_no_transaction(fabric, drone_host):
    for kind in (5, 6):  # a request for blocks, something of a peer
        answer = drone_host.call("forged", "set", asset("tello1/kind"), how="headerType", type=kind, broadcast=True)
        assert answer["status"] == (SUCCESS if fabric else BAD_REQUEST)


def test_who_endorses(fabric, drone_host):
    """The contract's policy is a majority of the organisations."""
    endorsers = drone_host.call("endorsers", "set", asset("tello1/endorsed"))["endorsers"]
    assert len(endorsers) == 2 if fabric else endorsers == ["Org1MSP", "Org2MSP", "Org3MSP"]


def test_the_command_lines_lifecycle(fabric, peer):
    done = peer.run("lifecycle", "chaincode", "querycommitted", "-C", "teleop")
    assert done.returncode == (0 if fabric else 1)
    assert "Name: ledgerline, Version: 4" in done.stdout if fabric else "no contract named '_lifecycle'" in done.stderr
