"""Who is no member, or signs wrongly, is refused by every service with the code that Fabric has for it."""
import time

import pytest
from ledgers import Authority
from official import (ABORTED, FAILED_PRECONDITION, FORBIDDEN, PERMISSION_DENIED, SUCCESS, UNKNOWN, Client, asset)

SERVICES = ("peer", "filtered", "private", "orderer")
OUTSIDERS = ("wrong key", "high S", "unknown CA", "another organisation's CA", "unknown MSP", "no certificate")


@pytest.fixture(scope="session")
def outsiders(ledger, tmp_path_factory, authority):
    own, other = ledger.identity(1, "User1"), ledger.identity(2, "User1")
    foreign = Authority(ledger, 1, tmp_path_factory.mktemp("foreign") / "org1")
    foreign.replace_by_own_ca()
    now = time.time()
    return {
        "wrong key": {**own, "key": other["key"]},
        "high S": {**own, "highS": True},
        "unknown CA": foreign.issue("Mallory", now - 60, now + 3600),
        "another organisation's CA": {**own, "mspId": "Org2MSP"},
        "unknown MSP": {**own, "mspId": "Org9MSP"},
        "no certificate": {**own, "certificate": "none"},
    }


def refused_everywhere(client: Client, tx: str) -> None:
    endorse = client.call("endorse", "set", asset("tello1/never"))["error"]
    assert endorse["code"] == ABORTED
    assert endorse["details"][0].startswith("error validating proposal: access denied: ")
    assert client.call("evaluate", "get", "tello1/note")["error"]["code"] == FAILED_PRECONDITION
    proposed = client.call("propose", "get", "tello1/note")["error"]
    assert proposed["code"] == UNKNOWN and "access denied" in proposed["message"]
    assert client.ask("status", tx=tx)["error"]["code"] == PERMISSION_DENIED
    assert client.ask("events", start=0, count=1)["error"]["code"] == PERMISSION_DENIED
    for service in SERVICES:
        assert client.ask("seek", service=service, start=0, stop=0) == {"numbers": [], "status": FORBIDDEN}


@pytest.mark.parametrize("who", OUTSIDERS)
def test_an_outsider_is_refused_everywhere(node, drone_host, outsiders, who):
    refused_everywhere(Client(node, outsiders[who]), drone_host.submit("set", asset("tello1/note"))["tx"])


def test_a_member_whom_nobody_has_met_is_served(node, drone_host, authority):
    """The counterpart of the expired one: issued in the same way, but valid."""
    now = time.time()
    member = Client(node, authority.issue("Guest", authority.begin() + 1, now + 3600))
    assert member.submit("set", asset("Org1MSP/guest"))["code"] == 0
    assert member.refusal("set", asset("tello1/a")).startswith("tello1: enrolled to Org1MSP CN=User1@org1.ledgerline")
    for service in SERVICES:
        assert member.ask("seek", service=service, start=0, stop=0) == {"numbers": [0], "status": SUCCESS}


def test_a_member_whose_certificate_has_expired_writes_nothing(node, drone_host, authority):
    member = Client(node, authority.issue("Former", authority.begin() + 1, lasts_s=3))
    # Endorsed in time, submitted too late.
    late = member.call("slow", "set", asset("Org1MSP/late"), until=1000 * (member.identity["end"] + 1.1))["error"]
    assert late["code"] == ABORTED
    assert late["message"].endswith("status=BAD_REQUEST, info=broadcast client identity expired")
    assert member.call("submit", "set", asset("Org1MSP/late"))["error"]["code"] == ABORTED
    proposed = member.call("propose", "get", "Org1MSP/note")["error"]
    assert proposed["code"] == UNKNOWN and "expired" in proposed["message"]
    for service in SERVICES:
        assert member.ask("seek", service=service, start=0, stop=0) == {"numbers": [], "status": FORBIDDEN}
    assert drone_host.refusal("get", "Org1MSP/late") == "Org1MSP/late: not found"
