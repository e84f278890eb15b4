"""Transactions from their proposal to their flag: replay, conflict, forgery, size."""
import base64

import pytest
from ledgers import BATCH_BYTES
from official import (ABORTED, BAD_PROPOSAL_TXID, BAD_REQUEST, DEADLINE_EXCEEDED, DUPLICATE_TXID,
                      ENDORSEMENT_POLICY_FAILURE, FAILED_PRECONDITION, FORBIDDEN, INVALID_ENDORSER_TRANSACTION,
                      MVCC_READ_CONFLICT, PERMISSION_DENIED, PHANTOM_READ_CONFLICT, SUCCESS, UNAVAILABLE, VALID, asset,
                      asset_bytes, call, decode)

LIMIT = 10 * 1024 * 1024  # AbsoluteMaxBytes
TRIES = 20  # until two transactions share a block: they are sent at once, and a block waits 25 ms


def flags(client, tx: str, start: int) -> list[int]:
    """Of every transaction with this id from a block on, to the newest one."""
    end = client.submit("set", asset("tello1/end"))["block"]
    blocks = client.ask("filtered", start=start, count=end - start + 1)["blocks"]
    return [one["code"] for block in blocks for one in block["transactions"] if one["tx"] == tx]


def test_a_proposal_answered_by_the_peer_itself_has_its_endorsement(drone_host):
    answer = drone_host.call("propose", "set", asset("tello1/direct"))
    assert answer["status"] == 200 and answer["endorsed"]


def test_unknown_channels_and_contracts_are_reported_apart_by_their_codes(drone_host):
    channel, contract = {"channel": "nowhere"}, {"contract": "nothing"}
    assert drone_host.call("endorse", "get", "x", **channel)["error"]["code"] == FAILED_PRECONDITION
    assert drone_host.call("evaluate", "get", "x", **channel)["error"]["code"] == UNAVAILABLE
    assert drone_host.ask("status", tx="0" * 64, **channel)["error"]["code"] == PERMISSION_DENIED
    assert drone_host.ask("events", start=0, count=1, **channel)["error"]["code"] == PERMISSION_DENIED
    proposed = drone_host.call("propose", "get", "x", **channel)
    assert (proposed["status"], proposed["message"]) == (500, "channel 'nowhere' not found")

    assert drone_host.call("endorse", "get", "x", **contract)["error"]["code"] == FAILED_PRECONDITION
    assert drone_host.call("evaluate", "get", "x", **contract)["error"]["code"] == FAILED_PRECONDITION
    proposed = drone_host.call("propose", "get", "x", **contract)
    assert proposed["status"] == 500 and "nothing" in proposed["message"] and not proposed["endorsed"]


def test_a_transaction_remains_known_by_its_id(drone_host):
    written = drone_host.submit("set", asset("tello1/known"))
    assert drone_host.ask("status", tx=written["tx"]) == {"code": VALID, "block": written["block"]}
    assert drone_host.ask("status", tx="0" * 64, ms=300)["error"]["code"] == DEADLINE_EXCEEDED


def test_a_transaction_again_is_not_endorsed_and_flagged_when_submitted(drone_host):
    again = drone_host.call("replay", "set", asset("tello1/replayed"))
    assert again["first"]["code"] == VALID
    assert again["endorse"]["code"] == ABORTED
    assert "duplicate transaction found" in again["endorse"]["details"][0]
    assert again["evaluate"]["code"] == FAILED_PRECONDITION
    # The status of an id is its first one; the second envelope is in a block behind it.
    assert again["second"] == again["first"]
    assert flags(drone_host, again["first"]["tx"], again["first"]["block"]) == [VALID, DUPLICATE_TXID]
    assert len(drone_host.read("history", "tello1/replayed")["versions"]) == 1


def words(error: dict) -> str:
    """All that an error says."""
    return "; ".join([error["message"], *error["details"]])


def in_one_block(client, *calls: dict) -> list[dict]:
    for _ in range(TRIES):
        done = client.ask("together", calls=list(calls))["all"]
        if len({one["block"] for one in done}) == 1:
            return done
    pytest.fail(f"no two of {TRIES} pairs came into one block")


def test_of_two_in_one_block_that_read_and_write_the_same_one_is_valid(operator, enroll):
    """The other one leaves no trace but its flag: no change, no event."""
    enroll("fought")
    for _ in range(TRIES):
        acquired = operator.ask("together", calls=[call("acquire", "fought"), call("acquire", "fought")])["all"]
        assert sorted(one["code"] for one in acquired) == [VALID, MVCC_READ_CONFLICT]
        released = operator.submit("release", "fought")
        if acquired[0]["block"] == acquired[1]["block"]:
            break
    else:
        pytest.fail(f"no two of {TRIES} pairs came into one block")
    events = operator.ask("events", start=acquired[0]["block"], count=2)["events"]
    valid = next(one for one in acquired if one["code"] == VALID)
    assert [event["tx"] for event in events] == [valid["tx"], released["tx"]]
    lost = next(one for one in acquired if one["code"] == MVCC_READ_CONFLICT)
    # Filtered blocks name its event all the same, beside the flag.
    (block,) = operator.ask("filtered", start=lost["block"], count=1)["blocks"]
    assert {"tx": lost["tx"], "code": MVCC_READ_CONFLICT, "events": [["acquire", ""]]} in block["transactions"]


def test_blind_writes_of_one_key_in_one_block_are_all_valid(drone_host):
    done = in_one_block(drone_host, *(call("set", asset("tello1/blind", bytes([number]))) for number in range(2)))
    assert [one["code"] for one in done] == [VALID, VALID]
    versions = drone_host.read("history", "tello1/blind")["versions"]
    assert {versions[0]["txId"], versions[1]["txId"]} == {one["tx"] for one in done}
    newest = drone_host.read("get", "tello1/blind")
    assert newest["msgData"] == versions[0]["asset"]["msgData"]


def test_a_range_that_got_a_new_key_meanwhile_is_a_phantom(drone_host):
    drone_host.submit("set", asset("tello1/range/a"))
    late = drone_host.call("late", "get", "tello1/range/*", between=call("set", asset("tello1/range/b")))
    assert late["code"] == PHANTOM_READ_CONFLICT
    late = drone_host.call("late", "get", "tello1/range/*", between=call("set", asset("tello1/other")))
    assert late["code"] == VALID


def test_many_writers_at_once_lose_nothing(node, drone_host, operator, nobody):
    """Each listener sees the same transactions in the same order, which is the order of the blocks."""
    start = drone_host.submit("set", asset("tello1/go"))["block"] + 1
    writers = [node.user(1, "User1"), node.user(2, "User2"), node.user(3, "User1"), nobody]
    names = ["tello1", "Org2MSP", "Org3MSP", "Org3MSP"]
    each = 15
    listeners = [(client, client.send("events", start=start, count=len(writers) * each))
                 for client in (operator, nobody)]
    sent = [(writer, writer.send("submit", **call("set", asset(f"{name}/w{index}/{number % 3}"))))
            for number in range(each) for index, (writer, name) in enumerate(zip(writers, names))]
    done = [writer.receive(request) for writer, request in sent]
    assert all(one.get("successful") for one in done), done
    first, second = (client.receive(request)["events"] for client, request in listeners)
    assert first == second
    assert {event["tx"] for event in first} == {one["tx"] for one in done}
    assert [event["block"] for event in first] == sorted(event["block"] for event in first)
    assert {event["tx"]: event["block"] for event in first} == {one["tx"]: one["block"] for one in done}


FORGERIES = {
    "input": INVALID_ENDORSER_TRANSACTION,
    "twoActions": INVALID_ENDORSER_TRANSACTION,
    "result": ENDORSEMENT_POLICY_FAILURE,
    "unendorsed": ENDORSEMENT_POLICY_FAILURE,
    "endorsedByItself": ENDORSEMENT_POLICY_FAILURE,
}


@pytest.mark.parametrize("how", FORGERIES)
def test_a_transaction_that_its_signer_changed_is_flagged(drone_host, how):
    forged = drone_host.call("forged", "set", asset("tello1/forged"), how=how)
    assert forged.get("code") == FORGERIES[how], forged
    assert drone_host.refusal("get", "tello1/forged") == "tello1/forged: not found"


def test_a_transaction_under_a_wrong_id_is_flagged(drone_host):
    wrong = "ab" * 32
    start = drone_host.submit("set", asset("tello1/before"))["block"]
    assert drone_host.call("forged", "set", asset("tello1/forged"), how="transactionId", txId=wrong,
                           without_status=True)["tx"] != wrong
    assert flags(drone_host, wrong, start) == [BAD_PROPOSAL_TXID]


def test_an_orderer_acknowledges_or_says_why_not(drone_host):
    def acknowledged(how: str, **more) -> dict:
        return drone_host.call("forged", "set", asset("tello1/ordered"), how=how, broadcast=True, **more)

    assert acknowledged("nothing") == {"status": SUCCESS, "info": ""}
    assert acknowledged("signature")["status"] == FORBIDDEN
    assert acknowledged("channel")["status"] == BAD_REQUEST
    large = acknowledged("size", bytes=LIMIT + 10)
    assert large["status"] == BAD_REQUEST and large["info"].startswith("message payload is 104857")
    for kind in (1, 2, 4):  # config, config update, orderer transaction
        assert acknowledged("headerType", type=kind)["status"] == BAD_REQUEST


def test_a_wrong_signature_on_a_transaction_does_not_reach_a_block(drone_host):
    refused = drone_host.call("forged", "set", asset("tello1/forged"), how="signature")["error"]
    assert refused["code"] == ABORTED
    assert "from orderer: status=FORBIDDEN" in words(refused)


def test_an_envelope_above_the_orderers_limit_is_refused_with_its_size(drone_host):
    refused = drone_host.call("forged", "set", asset("tello1/size"), how="size", bytes=LIMIT + 10)["error"]
    assert refused["code"] == ABORTED
    assert "status=BAD_REQUEST, info=message payload is 104857" in words(refused)
    assert f"allowed {LIMIT} bytes" in words(refused)
    # At the limit it is ordered; what nobody knows in it does no harm.
    assert drone_host.call("forged", "set", asset("tello1/size"), how="size", bytes=LIMIT)["code"] == VALID


def test_an_envelope_above_the_bytes_of_a_block_has_one_of_its_own(drone_host):
    small = call("set", asset("tello1/small"))
    large = {**small, "how": "size", "bytes": BATCH_BYTES + 100_000}
    for _ in range(TRIES):
        done = drone_host.ask("together", calls=[small, large, small, small])["all"]
        assert [one["code"] for one in done] == [VALID] * 4
        blocks = [one["block"] for one in done]
        assert blocks.count(blocks[1]) == 1
        if len(set(blocks)) < 4:  # the others did share one
            break
    else:
        pytest.fail("no two of the small ones came into one block")


def test_an_asset_of_nearly_a_megabyte_is_read_back(drone_host, nobody):
    data = bytes(range(256)) * 3906  # 999,936 bytes; the call may have 1,000,000
    written = drone_host.submit("set", asset_bytes("tello1/large", data))
    assert base64.b64decode(nobody.read("get", "tello1/large")["msgData"]) == data
    (event,) = nobody.ask("events", start=written["block"], count=1)["events"]
    assert decode(event["payload"]).endswith(data)
