"""Who is no member, or signs wrongly, is refused by every service with the code that Fabric has for it; and whose endorsement counts
for what."""
import base64
import hashlib
import time

import pytest
from conftest import subject
from ledgers import Authority
from official import (ABORTED, ENDORSEMENT_POLICY_FAILURE, FAILED_PRECONDITION, FORBIDDEN, PERMISSION_DENIED, SUCCESS, UNKNOWN,
                      VALID, Client, asset, encode)

SERVICES = ("peer", "filtered", "private", "orderer")
ANCHORED = bytes(range(32))
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
    member = Client(node, authority.issue("Former", authority.begin() + 1, lasts_s=8))  # a busy machine takes seconds to endorse
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


# --- whose endorsement which key needs: what a peer's key alone can write, as if there were no contract

def digest(organisation: int, user: str) -> str:
    return hashlib.sha256(f"Org{organisation}MSP\n{subject(organisation, user)}".encode()).hexdigest()


@pytest.fixture(scope="session")
def keys(node, admin, enroll, operator) -> dict[str, str]:
    """Every kind of record of a drone of Org1 that an operator of Org2 flies."""
    enroll("kept1", "kept2")
    operator.submit("acquire", {"drones": ["kept1"]})
    guard = enroll(organisation=1, user="User2", role="OPERATOR")
    guard.submit("stop", "kept2")
    guard.submit("clear_stop", "kept2")
    guard.submit("anchor", {"digest": base64.b64encode(ANCHORED).decode()})
    host, pilot, guarding = digest(1, "User1"), digest(2, "User1"), digest(1, "User2")
    return {"role": f"role/Org1MSP/{guarding[0]}", "stop": f"stop/kept2/{guarding}", "lifted": f"stop/kept2/{guarding}/lifted",
            "anchor": f"anchor/{ANCHORED.hex()}/Org1MSP/{guarding}",
            "control": "control/kept1", "owner": "owner/kept1", "grant": "grant/kept1", "request": "request/kept1",
            "host": f"host/{host}", "frame": f"frame/{host}", "drones": "drones/Org1MSP",
            "lease": f"lease/Org1MSP/{pilot}/1", "pilot": f"pilot/Org1MSP/{pilot}", "command": f"command/Org1MSP/{pilot}"}


@pytest.fixture(scope="session")
def forge(node, ledger):
    """A transaction of Org3's User1 that writes whatever it wants, endorsed by these organisations' peers; its flag."""
    def forge_one(writes: list, *organisations: int, policies: list = ()) -> int:
        peers = [ledger.identity(k, "peer0") for k in organisations]
        answer = Client(node, ledger.identity(3, "User1")).call(
            "forged", "set", asset("Org3MSP/forged"), how="writes", peers=peers,
            writes=writes, policies=list(policies))
        assert "code" in answer, answer
        return answer["code"]
    return forge_one


def write(key: str) -> dict:
    return {"key": key, "value": encode("forged")}


def policy(key: str, organisation: int | None) -> dict:
    return {"key": key, "mspId": f"Org{organisation}MSP" if organisation else None}


KEPT = ["control", "owner", "grant", "request", "host", "frame", "drones", "lease", "pilot", "command", "role"]
KINDS = KEPT + ["stop", "lifted", "anchor"]  # the others need any two


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("organisation", [2, 3])
def test_anothers_peer_cannot_touch_a_record(forge, keys, kind, organisation):
    key = keys[kind]
    free = f"free/{kind}{organisation}"
    refused = {
        "writes": forge([write(key)], organisation),
        "deletes": forge([{"key": key, "delete": True}], organisation),
        "takes the policy": forge([], organisation, policies=[policy(key, organisation)]),
        "removes the policy": forge([], organisation, policies=[policy(key, None)]),
        "writes beside a free key": forge([write(key), write(free)], organisation),
    }
    assert set(refused.values()) == {ENDORSEMENT_POLICY_FAILURE}, refused


def test_nobodys_peer_alone_makes_a_record(forge, keys):
    for organisation in (1, 2, 3):
        for key in (f"lease/Org1MSP/{digest(3, 'User9')}/1", "control/kept9", f"stop/kept1/{digest(3, 'User9')}",
                    "role/Org9MSP/0", f"grant/kept{organisation}x"):
            assert forge([write(key)], organisation) == ENDORSEMENT_POLICY_FAILURE, key
            assert forge([write(key)], organisation, policies=[policy(key, organisation)]) == ENDORSEMENT_POLICY_FAILURE, key


def test_two_others_cannot_change_what_has_a_keeper(forge, keys):
    """They can make keys that are not there: docs/ledger.md says what readers make of those."""
    for kind in KEPT:
        assert forge([write(keys[kind])], 2, 3) == ENDORSEMENT_POLICY_FAILURE, kind
    for table in "0123456789abcdef":  # who has no role yet gets one by its organisation's peer alone
        assert forge([write(f"role/Org1MSP/{table}")], 2, 3) == ENDORSEMENT_POLICY_FAILURE, table
    assert forge([write("free/two")], 2, 3) == VALID
    assert forge([write("free/two")], 2) == ENDORSEMENT_POLICY_FAILURE


def test_the_policy_outlives_writes_and_goes_with_its_key(forge):
    key = "free/own"
    assert forge([write(key)], 1, 3, policies=[policy(key, 1)]) == VALID
    assert forge([write(key)], 3) == ENDORSEMENT_POLICY_FAILURE
    assert forge([write(key)], 1) == VALID
    assert forge([write(key)], 3) == ENDORSEMENT_POLICY_FAILURE
    assert forge([{"key": key, "delete": True}], 1) == VALID
    assert forge([write(key)], 1) == ENDORSEMENT_POLICY_FAILURE, "it is created again: the contract's policy"
    assert forge([write(key)], 2, 3) == VALID


def test_a_policy_of_a_key_that_is_not_there_has_no_effect(forge):
    assert forge([], 1, 2, policies=[policy("free/nothing", 1)]) == VALID
    assert forge([write("free/nothing")], 1) == ENDORSEMENT_POLICY_FAILURE
    assert forge([write("free/nothing")], 2, 3) == VALID


def test_who_endorses_what(drone_host, operator, forge, keys, admin):
    """A state and a command go with one endorsement, the right one; making and taking need two."""
    frame = {"assets": [asset("kept1/odom")], "stream": True}
    drone_host.submit("set", frame)
    assert endorsers(drone_host, "set", frame) >= {"Org1MSP"}
    plan = {"drone": "kept1", "epoch": "1", "setpoints": [{"atNs": "1000", "vx": 0.5}]}
    command = {"organisation": "Org1MSP", "plans": [plan]}
    operator.submit("command", command)
    assert "Org1MSP" in endorsers(operator, "command", command)
    assert len(endorsers(operator, "stop", "kept1")) >= 2
    assert len(endorsers(admin(1), "enroll", {"identity": {"mspId": "Org1MSP", "subject": subject(1, "User1")},
                                              "drones": ["kept3"]})) >= 2


def endorsers(client: Client, fn: str, *args) -> set[str]:
    return set(client.call("endorsers", fn, *args)["endorsers"])
