"""Events and blocks: their order, their chain, from any place, up to any place."""
import hashlib
import json

import pytest
from official import BAD_REQUEST, NOT_FOUND, SUCCESS, asset, call, decode, field

SERVICES = ("peer", "filtered", "private", "orderer")


def height(client) -> int:
    return client.submit("set", asset("tello1/height"))["block"] + 1


def test_blocks_are_chained_and_flagged_from_the_config_block_on(drone_host):
    end = height(drone_host)
    blocks = drone_host.ask("blocks", start=0, count=end)["blocks"]
    assert [block["number"] for block in blocks] == list(range(end))
    for before, block in zip(blocks, blocks[1:]):
        assert decode(block["previous"]) == header_hash(before)
        assert decode(block["dataHash"]) == hashlib.sha256(b"".join(map(decode, block["data"]))).digest()
        assert len(block["flags"]) == len(block["data"])


def header_hash(block: dict) -> bytes:
    header = b"\x02" + der_length(der_integer(block["number"])) + der_integer(block["number"])
    for value in (decode(block["previous"]), decode(block["dataHash"])):
        header += b"\x04" + der_length(value) + value
    return hashlib.sha256(b"\x30" + der_length(header) + header).digest()


def der_integer(number: int) -> bytes:
    return number.to_bytes(number.bit_length() // 8 + 1, "big")


def der_length(content: bytes) -> bytes:
    assert len(content) < 128
    return bytes([len(content)])


def test_blocks_come_from_any_number_on_and_live(drone_host, nobody):
    end = height(drone_host)
    for start in (0, 1, end // 2, end - 1):
        blocks = nobody.ask("blocks", start=start, count=min(3, end - start))["blocks"]
        assert [block["number"] for block in blocks] == list(range(start, min(start + 3, end)))
    live = nobody.send("blocks", start=end, count=2)
    first, second = (drone_host.submit("set", asset("tello1/live"))["block"] for _ in range(2))
    assert [block["number"] for block in nobody.receive(live)["blocks"]] == [first, second]


def test_filtered_blocks_name_events_without_their_payload(drone_host):
    written = drone_host.submit("set", asset("tello1/filtered"))
    (block,) = drone_host.ask("filtered", start=written["block"], count=1)["blocks"]
    assert block == {"number": written["block"], "channel": "teleop",
                     "transactions": [{"tx": written["tx"], "code": 0, "events": [["set", ""]]}]}


@pytest.mark.parametrize("service", SERVICES)
def test_a_seek_is_served_from_its_start_to_its_stop(drone_host, service):
    end = height(drone_host)

    def seek(start, stop, **more):
        answer = drone_host.ask("seek", service=service, start=start, stop=stop, **more)
        return answer["numbers"], answer["status"]

    assert seek(0, 2) == ([0, 1, 2], SUCCESS)
    assert seek("oldest", "oldest") == ([0], SUCCESS)
    assert seek(2, 2) == ([2], SUCCESS)
    numbers, status = seek("newest", "newest")
    assert status == SUCCESS and len(numbers) == 1 and numbers[0] >= end - 1
    numbers, status = seek("oldest", "newest")
    assert status == SUCCESS and numbers == list(range(len(numbers))) and len(numbers) >= end
    assert seek(3, 2) == ([], BAD_REQUEST)
    assert seek(10**6, 10**6, orFail=True) == ([], NOT_FOUND)
    numbers, status = seek(end - 1, 10**6, orFail=True)
    assert status == NOT_FOUND and numbers[0] == end - 1
    assert seek(None, None) == ([], BAD_REQUEST)
    assert seek(0, 0, channel="nowhere") == ([], NOT_FOUND)


@pytest.mark.parametrize("service", SERVICES)
def test_an_old_request_for_blocks_is_refused(drone_host, service):
    """One that somebody has kept: its time is long past, its signature good."""
    answer = drone_host.ask("seek", service=service, start=0, stop=0, ageS=3600)
    assert answer == {"numbers": [], "status": BAD_REQUEST}


def test_events_come_live_in_the_form_of_their_call(drone_host, nobody):
    start = height(drone_host)
    live = nobody.send("events", start=start, count=2)
    drone_host.submit("set", asset("tello1/event"))
    drone_host.submit("delete", field(1, b"tello1/event"))
    first, second = nobody.receive(live)["events"]
    assert (first["name"], first["block"]) == ("set", start)
    assert json.loads(decode(first["payload"]))["assets"][0]["id"] == "tello1/event"
    assert (second["name"], decode(second["payload"])) == ("delete", field(1, b"tello1/event"))


def test_events_without_a_start_begin_with_the_next_block(drone_host, nobody):
    before = drone_host.submit("set", asset("tello1/before"))
    # When the first event is here the stream runs, so what follows is whole.
    live = nobody.send("events", count=3)
    after = []
    while len(after) < 60 and (len(after) < 3 or not nobody.arrived(live)):
        after.append(drone_host.submit("set", asset("tello1/next"))["tx"])
    events = [event["tx"] for event in nobody.receive(live)["events"]]
    first = after.index(events[0])
    assert events == after[first:first + 3] and before["tx"] not in events


def test_events_of_one_block_come_in_its_order(drone_host):
    calls = [call("set", asset(f"tello1/order/{number}")) for number in range(6)]
    done = drone_host.ask("together", calls=calls)["all"]
    start, end = min(one["block"] for one in done), max(one["block"] for one in done)
    blocks = drone_host.ask("filtered", start=start, count=end - start + 1)["blocks"]
    order = [tx["tx"] for block in blocks for tx in block["transactions"]]
    assert sorted(order) == sorted(one["tx"] for one in done)
    assert [event["tx"] for event in drone_host.ask("events", start=start, count=6)["events"]] == order


def test_events_go_on_behind_a_checkpoint_without_loss_or_duplicate(drone_host):
    written = [drone_host.submit("set", asset(f"tello1/c{number}")) for number in range(6)]
    events = drone_host.ask("checkpointed", start=written[0]["block"], counts=[1, 3, 2])["events"]
    assert [event["tx"] for event in events] == [tx["tx"] for tx in written]


def test_events_go_on_behind_a_transaction_wherever_it_is(drone_host):
    written = [drone_host.submit("set", asset("tello1/behind")) for _ in range(4)]
    # The transaction's own block counts, not the start that is named.
    for start in (0, written[3]["block"], None):
        where = {} if start is None else {"start": start}
        events = drone_host.ask("events", after=written[1]["tx"], count=2, **where)["events"]
        assert [event["tx"] for event in events] == [one["tx"] for one in written[2:]]


def test_other_contracts_have_no_events(drone_host, nobody):
    start = drone_host.submit("set", asset("tello1/own"))["block"]
    strange = nobody.send("events", start=start, count=1, contract="nothing")
    assert len(drone_host.ask("events", start=start, count=1)["events"]) == 1
    assert not nobody.arrived(strange)
