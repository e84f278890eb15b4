"""Hyperledger's own client (@hyperledger/fabric-gateway) against ledgerline-node and against Fabric itself."""
import base64
import hashlib
import json
import pathlib
import signal
import subprocess

from conftest import BIN, Client, Ledger, decode, encode


def asset(name: str, data: bytes = b"\x00\x01\x00\x00hello") -> dict:
    return {"id": name, "msgType": "std_msgs/msg/String", "msgData": base64.b64encode(data).decode()}


def field(number: int, content: bytes) -> bytes:
    """One length-delimited field of protobuf."""
    length, size = bytearray(), len(content)
    while True:
        length.append((size & 0x7F) | (0x80 if size > 0x7F else 0))
        size >>= 7
        if not size:
            return bytes([number << 3 | 2]) + bytes(length) + content


def message(fields: bytes) -> dict[int, list[bytes]]:
    """The length-delimited fields of a message that has no others."""
    found, at = {}, 0
    while at < len(fields):
        number, at = fields[at] >> 3, at + 1
        size = shift = 0
        while True:
            byte, at = fields[at], at + 1
            size |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
        found.setdefault(number, []).append(fields[at:at + size])
        at += size
    return found


def test_an_asset_in_json_is_written_and_read_back(drone_host):
    written = drone_host.call("submit", "set", asset("tello1/note"))
    assert written["successful"] and written["code"] == 0
    answer = json.loads(decode(drone_host.call("evaluate", "get", "tello1/note")["result"]))
    assert answer == {**asset("tello1/note"), "topic": "/tello1/note"}


def test_an_asset_in_protobuf_is_written_and_read_back(drone_host):
    call = field(1, field(1, b"tello2/note") + field(3, b"a/msg/B") + field(4, b"\x00\xff"))
    assert drone_host.call("submit", "set", call)["successful"]
    answer = message(decode(drone_host.call("evaluate", "get", field(1, b"tello2/note"))["result"]))
    assert message(answer[1][0]) == {1: [b"tello2/note"], 2: [b"/tello2/note"], 3: [b"a/msg/B"], 4: [b"\x00\xff"]}


def test_what_the_contract_refuses_is_aborted_with_its_words(drone_host, operator):
    refused = operator.call("submit", "set", asset("tello1/note"))["error"]
    assert refused["name"] == "EndorseError" and refused["code"] == 10
    assert refused["details"][0].startswith("chaincode response 500, tello1: enrolled to Org1MSP")
    missing = drone_host.call("evaluate", "get", "tello1/nothing")["error"]
    assert missing["code"] == 2
    assert missing["details"] == ["chaincode response 500, tello1/nothing: not found"]


def test_a_wrong_key_is_refused_everywhere(drone_host):
    endorse = drone_host.call("badSignature", "set", asset("tello1/note"), how="submitTransaction")["error"]
    assert endorse["code"] == 10 and "access denied" in endorse["details"][0]
    evaluate = drone_host.call("badSignature", "get", "tello1/note", how="evaluateTransaction")["error"]
    assert evaluate["code"] == 9


def test_unknown_channels_and_contracts_are_told_apart_by_their_codes(drone_host):
    where = {"channel": "nowhere", "contract": "ledgerline"}
    assert drone_host.call("elsewhere", "get", "x", how="submitTransaction", **where)["error"]["code"] == 9
    assert drone_host.call("elsewhere", "get", "x", how="evaluateTransaction", **where)["error"]["code"] == 14
    where = {"channel": "teleop", "contract": "nothing"}
    assert drone_host.call("elsewhere", "get", "x", how="submitTransaction", **where)["error"]["code"] == 9


def test_a_call_that_read_what_another_changed_is_invalidated(operator):
    acquire = {"fn": "acquire", "args": [encode("tello9")]}
    assert operator.ask("together", calls=[acquire, acquire]) == {"codes": [0, 11]}


def test_the_same_transaction_twice_is_flagged_in_its_block(drone_host):
    first = drone_host.call("twice", "set", asset("tello1/twice"))
    # The status of an id is its first one; the second envelope is in the block behind it.
    assert first["code"] == 0
    assert drone_host.call("submit", "set", asset("tello1/after"))["successful"]
    events = drone_host.ask("filtered", start=0, count=drone_host.call("submit", "set", asset("tello1/end"))["block"] + 1)
    codes = [tx["code"] for block in events["blocks"] for tx in block["transactions"] if tx["tx"] == first["tx"]]
    assert codes == [0, 9]


def test_blocks_are_chained_and_flagged_from_the_config_block_on(drone_host):
    last = drone_host.call("submit", "set", asset("tello1/note"))["block"]
    blocks = drone_host.ask("blocks", start=0, count=last + 1)["blocks"]
    assert [block["number"] for block in blocks] == list(range(last + 1))
    for before, block in zip(blocks, blocks[1:]):
        header = b"\x02" + der_length(der_integer(before["number"])) + der_integer(before["number"])
        for value in (decode(before["previous"]), decode(before["dataHash"])):
            header += b"\x04" + der_length(value) + value
        assert decode(block["previous"]) == hashlib.sha256(b"\x30" + der_length(header) + header).digest()
        assert decode(block["dataHash"]) == hashlib.sha256(b"".join(map(decode, block["data"]))).digest()
        assert len(block["flags"]) == len(block["data"])


def der_integer(number: int) -> bytes:
    return number.to_bytes(number.bit_length() // 8 + 1, "big")


def der_length(content: bytes) -> bytes:
    assert len(content) < 128
    return bytes([len(content)])


def test_filtered_blocks_name_events_without_their_payload(drone_host):
    written = drone_host.call("submit", "set", asset("tello1/note"))
    (block,) = drone_host.ask("filtered", start=written["block"], count=1)["blocks"]
    assert block == {"number": written["block"], "channel": "teleop",
                     "transactions": [{"tx": written["tx"], "code": 0, "events": [["set", ""]]}]}


def test_events_come_live_in_the_form_of_their_call(connect, drone_host):
    listener = connect(3, "User2")
    start = drone_host.call("submit", "set", asset("tello1/before"))["block"] + 1
    listener.send("events", start=start, count=2)
    drone_host.call("submit", "set", asset("tello1/json"))
    drone_host.call("submit", "delete", field(1, b"tello1/json"))
    first, second = listener.receive()["events"]
    assert (first["name"], first["block"]) == ("set", start)
    assert json.loads(decode(first["payload"]))["assets"][0]["id"] == "tello1/json"
    assert (second["name"], decode(second["payload"])) == ("delete", field(1, b"tello1/json"))


def test_events_go_on_behind_a_checkpoint_without_loss_or_doublet(drone_host):
    written = [drone_host.call("submit", "set", asset(f"tello1/c{number}")) for number in range(6)]
    events = drone_host.ask("checkpointed", start=written[0]["block"], counts=[1, 3, 2])["events"]
    assert [event["tx"] for event in events] == [tx["tx"] for tx in written]


def test_history_shows_signers_and_deletion(drone_host):
    for data in (b"\x00\x01\x00\x00one", b"\x00\x01\x00\x00two"):
        drone_host.call("submit", "set", asset("tello1/past", data))
    drone_host.call("submit", "delete", "tello1/past")
    history = json.loads(decode(drone_host.call("evaluate", "history", "tello1/past")["result"]))["versions"]
    assert [version.get("deleted", False) for version in history] == [True, False, False]
    assert [base64.b64decode(version["asset"]["msgData"])[4:] for version in history[1:]] == [b"two", b"one"]
    assert all(version["signer"]["subject"].startswith("CN=User1@org1.ledgerline") for version in history)


def test_what_was_committed_survives_a_kill(tmp_path: pathlib.Path, node_modules):
    ledger = Ledger(tmp_path / "node", "--batch-count", "10", "--batch-timeout", "2")
    client = Client(node_modules, ledger, 1, "User1")
    written = client.call("submit", "set", asset("tello1/kept"))
    client.close()
    ledger.stop(signal.SIGKILL)
    ledger.start()
    client = Client(node_modules, ledger, 1, "User1")
    kept = json.loads(decode(client.call("evaluate", "get", "tello1/kept")["result"]))
    assert kept["id"] == "tello1/kept"
    assert client.call("submit", "set", asset("tello1/more"))["block"] == written["block"] + 1
    client.close()
    assert ledger.stop() == 0
    assert ledger.summary()["transactions"] == 4
    assert ledger.summary()["invalid"] == 0


def test_keys_are_for_their_owner_only(ledger):
    keys = [path for path in ledger.directory.rglob("*") if path.name.endswith("_sk") or path.suffix == ".key"]
    assert len(keys) > 20
    assert {oct(path.stat().st_mode & 0o777) for path in keys} == {"0o600"}


def test_a_second_node_in_the_same_directory_says_so(tmp_path: pathlib.Path):
    ledger = Ledger(tmp_path / "node")
    second = subprocess.run([BIN / "ledgerline-node", "--dir", ledger.directory, "--listen", "127.0.0.1:0"],
                            capture_output=True, text=True, timeout=20)
    assert second.returncode == 1 and "in use by another" in second.stderr
    assert ledger.stop() == 0


def test_a_node_whose_disk_takes_no_more_ends_and_loses_nothing_that_it_confirmed(tmp_path: pathlib.Path, node_modules):
    ledger = Ledger(tmp_path / "node", file_limit=200_000)
    client = Client(node_modules, ledger, 1, "User1")
    confirmed = []
    for number in range(100):
        answer = client.call("submit", "set", asset(f"tello1/n{number}", bytes(10_000)))
        if "error" in answer:
            break
        confirmed.append(f"tello1/n{number}")
    client.close()
    assert 3 < len(confirmed) < 100
    assert ledger.process.wait(timeout=20) == 1
    assert "the ledger stops: writing" in ledger.log()

    ledger.file_limit = None
    ledger.start()
    assert "was not finished" in ledger.log()
    client = Client(node_modules, ledger, 1, "User1")
    kept = json.loads(decode(client.call("evaluate", "get", "tello1/*")["result"]))["assets"]
    assert {one["id"] for one in kept} == set(confirmed)
    client.close()
    assert ledger.stop() == 0
