"""Whose endorsement which key needs: what a peer's key alone can write, as if there were no contract."""
import hashlib

import pytest
from conftest import subject
from official import ENDORSEMENT_POLICY_FAILURE, VALID, Client, asset, encode


def digest(organisation: int, user: str) -> str:
    return hashlib.sha256(f"Org{organisation}MSP\n{subject(organisation, user)}".encode()).hexdigest()


@pytest.fixture(scope="session")
def keys(node, admin, enroll, operator) -> dict[str, str]:
    """Every kind of record of a drone of Org1 that an operator of Org2 flies."""
    enroll("kept1", "kept2")
    operator.submit("acquire", {"drones": ["kept1"]})
    host, pilot = digest(1, "User1"), digest(2, "User1")
    return {"control": "control/kept1", "owner": "owner/kept1", "grant": "grant/kept1", "request": "request/kept1",
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


KINDS = ["control", "owner", "grant", "request", "host", "frame", "drones", "lease", "pilot", "command"]


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
                    f"role/{digest(3, 'User9')}", f"grant/kept{organisation}x"):
            assert forge([write(key)], organisation) == ENDORSEMENT_POLICY_FAILURE, key
            assert forge([write(key)], organisation, policies=[policy(key, organisation)]) == ENDORSEMENT_POLICY_FAILURE, key


def test_two_others_cannot_change_what_has_a_keeper(forge, keys):
    """They can make keys that are not there: docs/ledger.md says what readers make of those."""
    for kind in KINDS:
        assert forge([write(keys[kind])], 2, 3) == ENDORSEMENT_POLICY_FAILURE, kind
    assert forge([write("free/two")], 2, 3) == VALID
    assert forge([write("free/two")], 2) == ENDORSEMENT_POLICY_FAILURE


def test_the_policy_outlives_writes_and_goes_with_its_key(forge):
    key = "free/own"
    assert forge([write(key)], 1, 3, policies=[policy(key, 1)]) == VALID
    assert forge([write(key)], 3) == ENDORSEMENT_POLICY_FAILURE
    assert forge([write(key)], 1) == VALID
    assert forge([write(key)], 3) == ENDORSEMENT_POLICY_FAILURE
    assert forge([{"key": key, "delete": True}], 1) == VALID
    assert forge([write(key)], 1) == ENDORSEMENT_POLICY_FAILURE, "it is made anew: the contract's policy"
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
