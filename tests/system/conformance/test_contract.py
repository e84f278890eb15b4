"""Every function of the contract and every refusal (docs/ledger.md), through the official client."""
import base64
import hashlib
import json
import os

import pytest
from conftest import subject
from official import ABORTED, asset, asset_bytes, decode, field, message

pytestmark = pytest.mark.essential

HOST = f"Org1MSP {subject(1, 'User1')}"
OPERATOR = f"Org2MSP {subject(2, 'User1')}"
RIVAL = f"Org2MSP {subject(2, 'User2')}"
SUPERVISOR = f"Org1MSP {subject(1, 'User2')}"
FAR = f"Org3MSP {subject(3, 'User1')}"
NOBODY = f"Org3MSP {subject(3, 'User2')}"


def control(client, drone: str) -> dict:
    """The record of who flies it, as `get` shows it: in protobuf, in an asset."""
    record = message(base64.b64decode(client.read("get", f"control/{drone}")["msgData"]))
    return {"drone": record[1][0].decode(), "owner": record[2][0], "held": 3 in record, "stopped": 10 in record}


def plan(drone: str, **more) -> dict:
    at = {"atNs": "1000", "vx": 0.5}
    return {"drone": drone, "action": "FLY", "epoch": "1", "setpoints": [at], **more}


def points(*times: int) -> list[dict]:
    return [{"atNs": str(time)} for time in times]


def test_an_asset_in_json_is_written_and_read_back(drone_host):
    drone_host.submit("set", asset("tello1/json"))
    assert drone_host.read("get", "tello1/json") == {**asset("tello1/json"), "topic": "/tello1/json"}


def test_an_asset_in_protobuf_is_written_and_read_back(drone_host):
    drone_host.submit("set", asset_bytes("tello2/binary", b"\x00\xff"))
    answer = message(drone_host.evaluate("get", field(1, b"tello2/binary")))
    assert message(answer[1][0]) == {1: [b"tello2/binary"], 2: [b"/tello2/binary"], 3: [b"a/msg/B"], 4: [b"\x00\xff"]}


def test_many_assets_of_one_call_are_read_by_their_prefix_in_order(drone_host, nobody):
    names = [f"tello3/many/{number:03}" for number in range(130)]  # more than Fabric gives for one round trip
    drone_host.submit("set", {"assets": [asset(name) for name in reversed(names)]})
    assert [one["id"] for one in nobody.read("get", "tello3/many/*")["assets"]] == names
    assert nobody.read("get", "tello3/none/*") == {}


def test_an_organisation_writes_under_its_own_name(nobody):
    nobody.submit("set", asset("Org3MSP/notes"))
    assert nobody.read("get", "Org3MSP/notes")["id"] == "Org3MSP/notes"


def test_streaming_assets_live_in_their_owners_frame(enroll):
    host = enroll("streamer")
    frame = [asset("streamer/odom", b"odom"), asset("streamer/battery", b"full")]
    host.submit("set", {"assets": frame, "stream": True})
    host.submit("set", {"assets": [asset("streamer/odom", b"newer"), frame[1]], "stream": True})
    (record,) = [message(base64.b64decode(one["msgData"])) for one in host.read("get", "host/*")["assets"]]
    assert b"streamer" in record[1] and record[2] == [b"streamer/battery", b"streamer/odom"]
    assert base64.b64decode(host.read("get", "streamer/odom")["msgData"]) == b"newer"
    assert [one["id"] for one in host.read("get", "streamer/*")["assets"]] == ["streamer/battery", "streamer/odom"]
    versions = host.read("history", "streamer/odom")["versions"]
    assert [base64.b64decode(one["asset"]["msgData"]) for one in versions] == [b"newer", b"odom"]
    # Another frame of the same host: what streams no longer in it is found in the older one.
    host.submit("set", {"assets": [asset("streamer/odom", b"newest")], "stream": True})
    assert base64.b64decode(host.read("get", "streamer/battery")["msgData"]) == b"full"
    host.submit("delete", "streamer/battery")
    assert host.refusal("get", "streamer/battery") == "streamer/battery: not found"


def test_history_shows_signers_and_deletion_newest_first(drone_host, nobody):
    written = [drone_host.submit("set", asset("tello1/past", data)) for data in (b"one", b"two")]
    written.append(drone_host.submit("delete", "tello1/past"))
    assert drone_host.refusal("get", "tello1/past") == "tello1/past: not found"
    versions = nobody.read("history", "tello1/past")["versions"]
    assert [version["txId"] for version in versions] == [one["tx"] for one in reversed(written)]
    assert [version.get("deleted", False) for version in versions] == [True, False, False]
    assert [base64.b64decode(version["asset"]["msgData"]) for version in versions[1:]] == [b"two", b"one"]
    assert all(version["signer"] == {"mspId": "Org1MSP", "subject": subject(1, "User1")} for version in versions)
    times = [int(version["timestampNs"]) for version in versions]
    assert times == sorted(times, reverse=True)


def pages(client, fn: str, what: str) -> list[list[dict]]:
    """An answer in all its parts; each part is at most a megabyte and some brackets."""
    found, bookmark = [], []
    while True:
        answer = client.evaluate(fn, what, *bookmark)
        assert len(answer) < 1_100_000
        page = json.loads(answer)
        found.append(page.get("assets", []) + page.get("versions", []))
        if "bookmark" not in page:
            return found
        bookmark = [f"bookmark={page['bookmark']}"]


def test_many_assets_come_in_pages_of_a_megabyte(drone_host, nobody):
    names = [f"tello4/page/{number}" for number in range(7)]
    for name in names:
        drone_host.submit("set", asset_bytes(name, bytes(300_000)))
    found = pages(nobody, "get", "tello4/page/*")
    assert [len(page) for page in found] == [2, 2, 2, 1]
    assert [one["id"] for page in found for one in page] == names


def test_a_long_history_comes_in_pages_of_a_megabyte(drone_host, nobody):
    for number in range(3):
        drone_host.submit("set", asset_bytes("tello1/long", bytes([number]) * 450_000))
    found = [one for page in pages(nobody, "history", "tello1/long") for one in page]
    assert [base64.b64decode(one["asset"]["msgData"])[0] for one in found] == [2, 1, 0]


def test_a_delegate_commands_in_the_holders_place_and_nothing_else(enroll, operator, node):
    enroll("delegated")
    station = node.user(2, "User2")
    command = {"organisation": "Org1MSP", "plans": [plan("delegated")]}
    who = {"mspId": "Org2MSP", "subject": subject(2, "User2")}
    foreign = {"mspId": "Org1MSP", "subject": subject(1, "User1")}
    assert operator.refusal("acquire", {"drones": ["delegated"], "delegate": foreign}) == (
        f"acquire: {HOST} cannot command for {OPERATOR}: a delegate is of its holder's organisation")
    answer = operator.submit("acquire", {"drones": ["delegated"], "delegate": who})
    assert json.loads(decode(answer["result"]))["controls"][0]["delegate"] == who
    station.submit("command", command)
    assert operator.refusal("command", command) == (
        f"delegated: the lease is held by {OPERATOR}, who lets {RIVAL} command it; not by {OPERATOR}, "
        "who may acquire it without a delegate")
    assert station.refusal("release", "delegated").startswith(f"delegated: {RIVAL} does not hold the lease; {OPERATOR}, who lets")
    operator.submit("release", "delegated")
    assert station.refusal("command", command).startswith("delegated: the lease is held by nobody")


def test_who_flies_is_acquired_commanded_stopped_cleared_and_released(enroll, operator):
    host, rival = enroll("flown"), enroll(organisation=2, user="User2", role="OPERATOR")
    supervisor = enroll(user="User2", role="SUPERVISOR")

    def controls(answer: dict, kind: str = "controls") -> list[dict]:
        return json.loads(decode(answer["result"]))[kind]

    (lease,) = controls(operator.submit("acquire", "flown"))
    assert lease["epoch"] == "1" and lease["holder"] == {"mspId": "Org2MSP", "subject": subject(2, "User1")}
    assert lease["owner"] == {"mspId": "Org1MSP", "subject": subject(1, "User1")}
    operator.submit("command", {"organisation": "Org1MSP", "plans": [plan("flown")]})
    (lease,) = controls(rival.submit("acquire", "flown", "priority=3"))
    assert (lease["epoch"], lease["priority"], lease["holder"]["subject"]) == ("2", 3, subject(2, "User2"))
    assert operator.refusal("command", {"organisation": "Org1MSP", "plans": [plan("flown")]}) == (
        f"flown: the lease is held by {RIVAL}, not by {OPERATOR}, who may request it")
    (stopped,) = controls(rival.submit("stop", "flown"), "stops")
    assert stopped == {"drone": "flown", "stopper": {"mspId": "Org2MSP", "subject": subject(2, "User2")}}
    (stopped,) = controls(supervisor.submit("stop", "flown", "cut=true"), "stops")
    assert stopped == {"drone": "flown", "stopper": {"mspId": "Org1MSP", "subject": subject(1, "User2")}, "cut": True}
    (applied,) = controls(host.submit("apply_stops", "flown"))
    assert [stop["stopper"]["mspId"] for stop in applied["stoppers"]] == ["Org1MSP", "Org2MSP"]
    assert rival.refusal("command", {"organisation": "Org1MSP", "plans": [plan("flown", epoch="2")]}) == (
        f"flown: stopped by {SUPERVISOR}, {RIVAL}; only LAND is accepted until they, or a supervisor of Org1MSP, clear it")
    (cleared,) = controls(rival.submit("clear_stop", "flown"))
    assert [stop["stopper"]["mspId"] for stop in cleared["stoppers"]] == ["Org1MSP"]
    assert rival.refusal("clear_stop", "flown").startswith(f"flown: stopped by {SUPERVISOR}; only they")
    rival.submit("command", {"organisation": "Org1MSP", "plans": [plan("flown", action="LAND", epoch="2", setpoints=[])]})
    (cleared,) = controls(supervisor.submit("clear_stop", "flown"))
    assert "stoppers" not in cleared
    (released,) = controls(rival.submit("release", "flown"))
    assert released["epoch"] == "3" and "holder" not in released
    assert control(host, "flown") == {"drone": "flown", "owner": control(host, "tello1")["owner"], "held": False,
                                      "stopped": False}


def test_each_function_that_writes_emits_its_event_in_the_form_of_the_call(enroll, operator, nobody):
    host = enroll("reported")
    start = host.submit("set", asset("reported/a"))["block"]
    host.submit("set", asset_bytes("reported/b", b"b"))
    host.submit("delete", "reported/a")
    host.submit("delete", field(1, b"reported/b"))
    operator.submit("acquire", field(1, b"reported"))
    operator.submit("command", {"organisation": "Org1MSP", "plans": [plan("reported")]})
    operator.submit("stop", "reported")
    operator.submit("clear_stop", {"drones": ["reported"]})
    operator.submit("release", "reported")
    enroll("notified2")
    events = nobody.ask("events", start=start, count=11)["events"]
    assert [event["name"] for event in events] == ["set", "set", "delete", "delete", "acquire", "command", "stop",
                                                   "clear_stop", "release", "enroll", "grant"]
    payloads = [decode(event["payload"]) for event in events]
    assert json.loads(payloads[0]) == {"assets": [{**asset("reported/a"), "topic": "/reported/a"}]}
    assert message(message(payloads[1])[1][0])[4] == [b"b"]
    assert json.loads(payloads[2]) == {"id": "reported/a"}
    assert payloads[3] == field(1, b"reported/b")
    assert message(message(payloads[4])[1][0])[1] == [b"reported"]
    assert json.loads(payloads[5])["plans"][0]["setpoints"] == [{"atNs": "1000", "vx": 0.5}]
    (stop,) = json.loads(payloads[6])["stops"]
    assert stop["drone"] == "reported" and stop["stopper"]["mspId"] == "Org2MSP"
    for payload in payloads[7:9]:
        (record,) = json.loads(payload)["controls"]
        assert record["drone"] == "reported" and "stoppers" not in record
    for payload in payloads[9:]:
        assert json.loads(payload)["controls"][0]["drone"] == "notified2"


def test_a_role_means_nothing_on_others_drones_and_what_is_granted_can_be_taken_back(enroll, admin, operator):
    """An administrator of Org3 makes its own people whatever it likes; Org1's drone stays Org1's."""
    enroll("lent")
    far = enroll(organisation=3, user="User1", role="SUPERVISOR")
    supervisor = enroll(user="User2", role="SUPERVISOR")
    grant = lambda **may: admin(1).submit("grant", {"drones": ["lent"], "grant": {"to": {"mspId": "Org3MSP"}, **may}})
    for fn, *args in (("acquire", "priority=999999999"), ("stop",), ("stop", "cut=true"), ("evict",)):
        refusal = far.refusal(fn, "lent", *args)
        assert refusal.startswith(f"lent: {FAR} may not ") and "Org1MSP" in refusal, refusal
    grant(fly=True, maxPriority=5)
    assert far.refusal("acquire", "lent", "priority=6") == f"lent: Org1MSP has granted {FAR} priorities up to 5, not 6; an administrator of Org1MSP may grant more"
    far.submit("acquire", "lent", "priority=5")
    far.submit("command", {"organisation": "Org1MSP", "plans": [plan("lent")]})
    supervisor.submit("evict", "lent")
    assert far.refusal("command", {"organisation": "Org1MSP", "plans": [plan("lent")]}).startswith("lent: the lease is held by nobody")
    far.submit("acquire", "lent")
    assert far.refusal("stop", "lent", "cut=true").startswith(f"lent: {FAR} may not cut it")
    answer = json.loads(decode(grant()["result"]))["controls"][0]
    assert "holder" not in answer and [one["to"] for one in answer["grants"]] == [{"mspId": "Org2MSP"}]
    assert far.refusal("command", {"organisation": "Org1MSP", "plans": [plan("lent", epoch="3")]}).startswith("lent: the lease is held by nobody")
    assert far.refusal("acquire", "lent").startswith(f"lent: {FAR} may not fly it")
    operator.submit("acquire", "lent")


def test_what_is_anchored_is_verified_by_its_hash_alone(nobody, operator):
    call = {"digest": base64.b64encode(hashlib.sha256(os.urandom(16)).digest()).decode()}
    assert nobody.read("verify", call) == {}
    nobody.submit("anchor", {**call, "what": "flight 7"})
    operator.submit("anchor", call)
    assert nobody.refusal("anchor", call).endswith("has anchored this digest already; verify says when")
    anchors = nobody.read("verify", call)["anchors"]
    assert {one["signer"]["mspId"]: one.get("what") for one in anchors} == {"Org3MSP": "flight 7", "Org2MSP": None}
    assert all(one["txId"] and int(one["timestampNs"]) > 0 for one in anchors)
    # Of some signers, by their own keys, and of one organisation.
    signers = [{"mspId": f"Org{k}MSP", "subject": subject(k, "User1")} for k in (1, 2)]
    assert [one["signer"] for one in nobody.read("verify", {**call, "signers": signers})["anchors"]] == signers[1:]
    assert [one["signer"]["mspId"] for one in nobody.read("verify", {**call, "organisation": "Org3MSP"})["anchors"]] == ["Org3MSP"]
    assert nobody.read("verify", {**call, "organisation": "Org1MSP"}) == {}
    assert nobody.refusal("anchor", {**call, "organisation": "Org3MSP"}).startswith("anchor: signers, organisation and bookmark are of verify alone")


def test_two_operators_hand_a_drone_over(enroll, admin, operator):
    """One asks, the other answers; never nobody, never two."""
    enroll("shared")
    pilot = enroll(organisation=2, user="User2", role="OPERATOR")
    to = {"drones": ["shared"], "to": {"mspId": "Org2MSP", "subject": subject(2, "User2")}}
    words = f"Org2MSP {to['to']['subject']}"
    assert pilot.refusal("request", "shared") == "shared: nobody holds the lease; acquire it"
    operator.submit("acquire", "shared", "priority=7")
    assert operator.refusal("hand_over", to).startswith(f"shared: {words} has not requested it; it may request it")
    pilot.submit("request", "shared", "priority=3")
    operator.submit("command", {"organisation": "Org1MSP", "plans": [plan("shared")]})
    operator.submit("deny", to)
    assert operator.refusal("hand_over", to).startswith(f"shared: {words} has not requested it")
    pilot.submit("request", "shared", "priority=3")
    assert pilot.refusal("hand_over", to).startswith(f"shared: {words} does not hold the lease")
    record = json.loads(decode(operator.submit("hand_over", to)["result"]))["controls"][0]
    assert record["holder"] == to["to"] and record["priority"] == 3 and "requests" not in record
    assert operator.refusal("command", {"organisation": "Org1MSP", "plans": [plan("shared")]}).startswith(f"shared: the lease is held by {words}")
    pilot.submit("command", {"organisation": "Org1MSP", "plans": [plan("shared", epoch=record["epoch"])]})


def test_who_is_revoked_flies_nothing_once_the_host_has_applied_stops(enroll, admin, drone_host):
    enroll("kept")
    pilot = enroll(organisation=2, user="User2", role="OPERATOR")
    who = {"identity": {"mspId": "Org2MSP", "subject": subject(2, "User2")}}
    refusal = f"Org2MSP {who['identity']['subject']} is revoked; an administrator of Org2MSP may enroll it again"
    pilot.submit("acquire", "kept")
    pilot.submit("command", {"organisation": "Org1MSP", "plans": [plan("kept")]})
    assert admin(1).refusal("revoke", who) == "revoke: only an administrator of Org2MSP may revoke its identities"
    try:
        answer = json.loads(decode(admin(2).submit("revoke", who)["result"]))
        assert answer == {"identity": who["identity"], "role": "REVOKED"}
        assert pilot.refusal("acquire", "kept") == f"acquire: {refusal}"
        assert pilot.refusal("stop", "kept") == f"kept: {refusal}"
        pilot.submit("command", {"organisation": "Org1MSP", "plans": [plan("kept")]})
        record = json.loads(decode(drone_host.submit("apply_stops", {"drones": ["kept"]})["result"]))["controls"][0]
        assert "holder" not in record and "revoked" not in record
        assert pilot.refusal("command", {"organisation": "Org1MSP", "plans": [plan("kept")]}).startswith("kept: the lease is held by nobody")
    finally:
        enroll(organisation=2, user="User2", role="OPERATOR")
    pilot.submit("acquire", "kept")


@pytest.fixture(scope="session")
def scene(enroll, admin, drone_host, operator, nobody):
    """What refusals need: `leased` flown by the operator, `stopped` besides stopped by a supervisor, `free` streams."""
    enroll("leased", "stopped", "free", "full")
    rival = enroll(organisation=2, user="User2", role="OPERATOR")
    supervisor = enroll(user="User2", role="SUPERVISOR")
    operator.submit("acquire", "leased", "stopped", "priority=5")
    supervisor.submit("stop", "stopped")
    drone_host.submit("apply_stops", "stopped")
    drone_host.submit("set", asset("leased/gone"))
    drone_host.submit("delete", "leased/gone")
    streams = [{"id": f"full/{number}", "msgType": "t"} for number in range(64)]
    drone_host.submit("set", {"assets": streams, "stream": True})
    drone_host.submit("set", {"assets": [asset("free/odom")], "stream": True})
    far = enroll(organisation=3, user="User1", role="OPERATOR")
    return {"far": far, "host": drone_host, "operator": operator, "rival": rival, "supervisor": supervisor, "nobody": nobody,
            "admin": admin(1), "other admin": admin(2)}


def small(number: int) -> list[dict]:
    return [{"id": f"free/{i}", "msgType": "t"} for i in range(number)]


WHO = {"mspId": "Org1MSP", "subject": subject(1, "User1")}
REFUSALS = [
    ("host", "fly", ["x"], "unknown function fly; known are set, get, history, delete, enroll, revoke, grant, "
                           "acquire, release, request, hand_over, deny, evict, command, stop, clear_stop, apply_stops, claim, unclaim, "
                           "anchor, verify"),
    ("host", "get", ["a" * 1_000_001], "get: the call has 1000001 bytes; the limit is 1000000"),
    ("host", "get", ["{}", "x"], "get: give one message in protobuf or JSON, or plain ids; not both"),

    ("host", "set", ["tello1/a"], "set: give assets in protobuf or JSON"),
    ("host", "set", ['{"id": 1'], "not a SetCall in JSON: "),
    ("host", "set", [b"\xff\xff"], "not a SetCall in protobuf"),
    ("host", "set", [{"assets": []}], "set: no assets"),
    ("host", "set", [{"assets": small(1001)}], "the call has 1001 assets; the limit is 1000"),
    ("host", "set", [{"id": "", "msgType": "t"}], "an asset has no id"),
    ("host", "set", [{"id": "a" * 129, "msgType": "t"}], "a" * 128 + "...: the id has 129 characters; the limit is 128"),
    ("host", "set", [{"id": "tello1/ä", "msgType": "t"}], "an id has characters other than [A-Za-z0-9_./-]"),
    ("host", "set", [{"id": "tello1//a", "msgType": "t"}], "tello1//a: an id's segments must not be empty"),
    ("host", "set", [{"id": "Org1MSP/../tello1/odom", "msgType": "t"}],
     "Org1MSP/../tello1/odom: an id's segments must not be . or .."),
    ("host", "set", [{"id": "tello1/a", "topic": "/b", "msgType": "t"}],
     "tello1/a: the topic is /b, it must be /tello1/a"),
    ("host", "set", [{"id": "tello1/a"}], "tello1/a: msg_type must have 1 to 128 characters"),
    ("operator", "set", [asset("tello1/a")], f"tello1: enrolled to {HOST}, not to {OPERATOR}"),
    ("host", "set", [asset("ghost/a")], "ghost: not enrolled, and not your organisation (Org1MSP)"),
    ("host", "set", [asset("Org2MSP/a")], "Org2MSP: not enrolled, and not your organisation (Org1MSP)"),
    ("host", "set", [asset("free/odom")], "free/odom: it streams; set it with stream, or delete it first"),
    ("host", "set", [{"assets": [asset("Org1MSP/a")], "stream": True}],
     "Org1MSP/a: only ids under an enrolled name may stream"),
    ("host", "set", [{"assets": [asset("free/odom", bytes(32_000))], "stream": True}], "the batch has 32"),
    ("host", "set", [{"assets": [{"id": "full/more", "msgType": "t"}], "stream": True}],
     "full: 65 ids would stream; the limit is 64"),

    ("nobody", "get", ["a", "b"], "get: give one id"),
    ("nobody", "get", ["tello1/never"], "tello1/never: not found"),
    ("nobody", "get", ["control/ghost"], "control/ghost: not found"),
    ("nobody", "get", ["a//*"], "a/: an id's segments must not be empty"),
    ("nobody", "history", ["a", "b"], "history: give one id"),
    ("nobody", "history", ["tello1/never"], "tello1/never: not found"),
    ("nobody", "history", ["leased/gone", "bookmark=x"], "leased/gone: the bookmark is damaged"),
    ("nobody", "history", ["leased/gone", "bookmark=1:abc"], "leased/gone: the bookmark is too old; begin again"),

    ("host", "delete", ["a", "b"], "delete: give one id"),
    ("host", "delete", ["tello1/never"], "tello1/never: not found"),
    ("host", "delete", ["leased/gone"], "leased/gone: not found"),
    ("operator", "delete", ["leased/gone"], f"leased: enrolled to {HOST}, not to {OPERATOR}"),

    ("admin", "enroll", ["x"], "enroll: give an EnrollCall in protobuf or JSON"),
    ("admin", "enroll", [{"drones": ["x"]}], "enroll: identity needs mspId and subject"),
    ("host", "enroll", [{"identity": WHO, "drones": ["x"]}],
     "enroll: only an administrator of Org1MSP may enroll its identities"),
    ("other admin", "enroll", [{"identity": WHO, "drones": ["x"]}],
     "enroll: only an administrator of Org1MSP may enroll its identities"),
    ("admin", "enroll", [{"identity": WHO}], "enroll: name drones or a role"),
    ("admin", "enroll", [{"identity": WHO, "role": 9}], "enroll: unknown role 9"),
    ("admin", "enroll", [{"identity": WHO, "drones": ["control"]}], "control: a reserved word"),
    ("admin", "enroll", [{"identity": WHO, "drones": ["OrgMSP"]}], "OrgMSP: names that end with MSP belong to"),
    ("admin", "enroll", [{"identity": WHO, "drones": ["a/b"]}], "a/b: a drone's name is one segment, without /"),
    ("admin", "enroll", [{"identity": WHO, "drones": ["tf"]}], "tf: ROS 2 or motion capture needs this name"),
    ("admin", "enroll", [{"identity": WHO, "drones": ["1tello"]}], "1tello: a new drone's name must be a letter, then"),
    ("admin", "enroll", [{"identity": WHO, "drones": [".."]}], "..: an id's segments must not be . or .."),
    ("other admin", "enroll", [{"identity": {"mspId": "Org2MSP", "subject": subject(2, "User1")},
                                "drones": [f"many{number:03}" for number in range(257)]}],
     "many256: Org2MSP has 256 drones already, which is the limit"),
    ("other admin", "enroll", [{"identity": {**WHO, "mspId": "Org2MSP"}, "drones": ["leased"]}],
     "leased: enrolled to organisation Org1MSP already"),

    ("admin", "revoke", ["leased"], "revoke: give a RevokeCall in protobuf or JSON"),
    ("admin", "revoke", [{"identity": {"mspId": "Org1MSP"}}], "revoke: identity needs mspId and subject"),
    ("other admin", "revoke", [{"identity": WHO}], "revoke: only an administrator of Org1MSP may revoke its identities"),
    ("admin", "enroll", [{"identity": WHO, "role": "REVOKED"}], "enroll: REVOKED is no role; call revoke"),
    ("admin", "grant", ["leased"], "grant: give a GrantCall in protobuf or JSON"),
    ("admin", "grant", [{"drones": []}], "grant: no drone is named"),
    ("admin", "grant", [{"drones": ["leased"]}], "grant: to needs mspId"),
    ("admin", "grant", [{"drones": ["leased"], "grant": {"to": {"mspId": "Org1MSP"}, "fly": True}}],
     "leased: operators and supervisors of Org1MSP need no grant"),
    ("admin", "grant", [{"drones": ["leased"], "grant": {"to": {"mspId": "Org3MSP"}, "maxPriority": 1}}],
     "grant: maxPriority is of those who may fly"),
    ("admin", "grant", [{"drones": ["ghost"], "grant": {"to": {"mspId": "Org3MSP"}, "stop": True}}],
     "ghost: not enrolled"),
    ("other admin", "grant", [{"drones": ["leased"], "grant": {"to": {"mspId": "Org3MSP"}, "fly": True}}],
     f"leased: Org2MSP {subject(2, 'Admin')} may not grant it: only an administrator of Org1MSP may"),
    ("host", "grant", [{"drones": ["leased"], "grant": {"to": {"mspId": "Org3MSP"}, "fly": True}}],
     f"leased: {HOST} may not grant it"),
    ("nobody", "anchor", [{"digest": "YWJj"}], "anchor: digest has 3 bytes; a SHA-256 has 32"),
    ("nobody", "verify", ["abc"], "verify: give an AnchorCall in protobuf or JSON"),
    ("operator", "hand_over", ["leased"], "hand_over: give an AnswerCall in protobuf or JSON"),
    ("operator", "deny", [{"drones": ["leased"]}], "deny: to needs mspId and subject"),
    ("operator", "deny", [{"drones": ["leased"], "to": WHO}], f"leased: {HOST} has not requested it"),
    ("rival", "deny", [{"drones": ["leased"], "to": WHO}], f"leased: {RIVAL} may not deny it"),
    ("operator", "request", ["leased"], "leased: Org2MSP"),
    ("supervisor", "evict", ["free"], "free: nobody holds the lease"),
    ("rival", "evict", ["leased"], f"leased: {RIVAL} may not evict: neither a supervisor of Org1MSP nor the drone's host"),
    ("operator", "evict", [], "evict: no drone is named"),

    ("operator", "acquire", [], "acquire: no drone is named"),
    ("operator", "acquire", [{"drones": ["free"], "priority": 1_000_000_000}],
     "acquire: priority must be a number up to 999999999"),
    ("far", "acquire", ["free"], f"free: {FAR} may not fly it: Org1MSP has granted that neither to this identity nor to "
                                 "Org3MSP; an administrator of Org1MSP may"),
    ("operator", "acquire", ["free", "priority=high"], "acquire: priority must be a number up to 999999999"),
    ("operator", "acquire", ["ghost"], "ghost: not enrolled"),
    ("host", "acquire", ["free"], f"acquire: {HOST} is neither operator nor supervisor"),
    ("rival", "acquire", ["leased", "priority=5"], f"leased: the lease is held by {OPERATOR} with priority 5"),
    ("rival", "release", ["leased"], f"leased: {RIVAL} does not hold the lease"),
    ("rival", "release", [], "release: no drone is named"),

    ("operator", "command", ["leased"], "command: give plans in protobuf or JSON"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": []}], "command: no plans"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("ghost")]}], "ghost: not enrolled"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased"), plan("leased")]}], "leased: two plans in one call"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("free")]}], f"free: the lease is held by nobody, not by {OPERATOR}"),
    ("rival", "command", [{"organisation": "Org1MSP", "plans": [plan("leased")]}], f"leased: the lease is held by {OPERATOR}, not by {RIVAL}"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", epoch="7")]}],
     "leased: the lease's epoch is 1, the plan says 7"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("stopped")]}], f"stopped: stopped by {SUPERVISOR}; only LAND is accepted"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", action=9)]}], "leased: unknown action 9"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=[])]}], "leased: the plan has no setpoints"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=points(*range(41)))]}],
     "leased: the plan has 41 setpoints; the limit is 40"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=points(-1))]}],
     "leased: a setpoint's time is negative"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=points(2, 1))]}], "leased: the plan's times go backwards"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=points(0, 2_001_000_000))]}],
     "leased: the plan lasts 2001 ms; the limit is 2000 ms"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan("leased", setpoints=[{"vx": "NaN"}])]}],
     "leased: a setpoint is not finite"),
    ("operator", "command", [{"organisation": "Org1MSP", "plans": [plan(f"d{i}", setpoints=[]) for i in range(1001)]}],
     "the call has 1001 plans; the limit is 1000"),

    ("nobody", "stop", ["leased"], f"leased: {NOBODY} is neither operator nor supervisor; an "
                                   "administrator of Org3MSP may enroll it as one"),
    ("far", "stop", ["leased"], f"leased: {FAR} may not stop it: Org1MSP has granted that neither to this identity"),
    ("rival", "stop", ["leased", "cut=true"], f"leased: {RIVAL} may not cut it"),
    ("rival", "stop", ["ghost"], "ghost: not enrolled"),
    ("operator", "stop", ["leased", "cut=maybe"], "stop: cut must be true or false"),
    ("operator", "stop", [], "stop: no drone is named"),
    ("operator", "clear_stop", ["leased"], "leased: not stopped"),
    ("operator", "apply_stops", ["leased"], f"leased: enrolled to {HOST}, who alone applies its stops"),
    ("host", "apply_stops", [], "apply_stops: no drone is named"),
    ("rival", "claim", ["leased"], f"leased: {RIVAL} may not claim it: only a supervisor or administrator of Org1MSP"),
    ("operator", "clear_stop", ["stopped"], f"stopped: stopped by {SUPERVISOR}; only they, each its own, or a "
                                        "supervisor of Org1MSP may"),
]


@pytest.mark.parametrize("who, fn, args, words", REFUSALS, ids=[f"{r[1]}: {r[3][:60]}" for r in REFUSALS])
def test_the_contract_refuses(scene, who, fn, args, words):
    refusal = scene[who].refusal(fn, *args)
    assert refusal.startswith(words), refusal


def test_what_the_contract_refuses_is_not_endorsed(operator):
    refused = operator.call("submit", "set", asset("tello1/a"))["error"]
    assert refused["name"] == "EndorseError" and refused["code"] == ABORTED
    assert refused["details"][0].startswith("chaincode response 500, tello1: enrolled to Org1MSP")
    proposed = operator.call("propose", "set", asset("tello1/a"))
    assert proposed["status"] == 500 and not proposed["endorsed"]
    assert proposed["message"].startswith("tello1: enrolled to Org1MSP")
