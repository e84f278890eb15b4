"""Fabric's official Node.js client, and what tests write and read with it."""
import base64
import json
import os
import pathlib
import subprocess

from ledgers import Ledger

HERE = pathlib.Path(__file__).parent


class Node:
    """One process of the client; speaks for every identity, does many things at once."""

    def __init__(self, modules: pathlib.Path, ledger: Ledger):
        self.ledger = ledger
        self.answers = {}
        self.last = 0
        self.process = subprocess.Popen(
            ["node", HERE / "node/client.cjs", *map(str, (*ledger.peer(1), *ledger.orderer())), "teleop", "ledgerline"],
            env={**os.environ, "NODE_PATH": str(modules)}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def user(self, organisation: int, user: str) -> "Client":
        return Client(self, self.ledger.identity(organisation, user))

    def read(self) -> None:
        line = self.process.stdout.readline()
        assert line, "the client's process has ended"
        answer = json.loads(line)
        self.answers[answer.pop("id")] = answer

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=20)


class Client:
    """The client as one identity."""

    def __init__(self, node: Node, identity: dict):
        self.node = node
        self.identity = identity

    def send(self, op: str, **request) -> int:
        node = self.node
        node.last += 1
        node.process.stdin.write(json.dumps({"id": node.last, "op": op, "identity": self.identity, **request}) + "\n")
        node.process.stdin.flush()
        return node.last

    def receive(self, request: int) -> dict:
        while request not in self.node.answers:
            self.node.read()
        return self.node.answers.pop(request)

    def arrived(self, request: int) -> bool:
        """Whether its answer is here by now."""
        return request in self.node.answers

    def ask(self, op: str, **request) -> dict:
        return self.receive(self.send(op, **request))

    def call(self, op: str, fn: str, *args, **more) -> dict:
        return self.ask(op, **call(fn, *args), **more)

    def submit(self, fn: str, *args) -> dict:
        """To a transaction that is valid."""
        answer = self.call("submit", fn, *args)
        assert answer.get("successful"), answer
        return answer

    def evaluate(self, fn: str, *args) -> bytes:
        answer = self.call("evaluate", fn, *args)
        assert "result" in answer, answer
        return decode(answer["result"])

    def read(self, fn: str, *args) -> dict:
        return json.loads(self.evaluate(fn, *args))

    def refusal(self, fn: str, *args) -> str:
        """In the contract's words; the same when it is asked and when it is to endorse."""
        error = self.call("evaluate", fn, *args)["error"]
        assert error["code"] == UNKNOWN, error
        (detail,) = error["details"]
        assert detail.startswith("chaincode response 500, "), error
        return detail.removeprefix("chaincode response 500, ")


# gRPC's codes
INVALID_ARGUMENT, DEADLINE_EXCEEDED, PERMISSION_DENIED = 3, 4, 7
UNKNOWN, FAILED_PRECONDITION, ABORTED, UNAVAILABLE = 2, 9, 10, 14
# common.Status
SUCCESS, BAD_REQUEST, FORBIDDEN, NOT_FOUND = 200, 400, 403, 404
# protos.TxValidationCode
VALID, INVALID_ENDORSER_TRANSACTION, BAD_PROPOSAL_TXID, DUPLICATE_TXID = 0, 5, 8, 9
ENDORSEMENT_POLICY_FAILURE, MVCC_READ_CONFLICT, PHANTOM_READ_CONFLICT = 10, 11, 12


def call(fn: str, *args) -> dict:
    return {"fn": fn, "args": [encode(arg) for arg in args]}


def encode(arg) -> str:
    """Objects become JSON text, text and bytes stay what they are."""
    if isinstance(arg, dict):
        arg = json.dumps(arg)
    if isinstance(arg, str):
        arg = arg.encode()
    return base64.b64encode(arg).decode()


def decode(text: str) -> bytes:
    return base64.b64decode(text)


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
    """The length-delimited fields of a message; the other ones are left out."""
    found, at = {}, 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte, at = fields[at], at + 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(fields):
        key = varint()
        value = varint()
        assert key & 7 in (0, 2)
        if key & 7 == 2:
            found.setdefault(key >> 3, []).append(fields[at:at + value])
            at += value
    return found


def asset_bytes(name: str, data: bytes) -> bytes:
    """A set of one asset, in protobuf."""
    return field(1, field(1, name.encode()) + field(3, b"a/msg/B") + field(4, data))
