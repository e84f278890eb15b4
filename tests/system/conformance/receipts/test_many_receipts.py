"""Random receipts verify in an empty root, and changed ones do not."""
import concurrent.futures
import os
import random

from empty_root import ORGANISATIONS, empty_root, make  # noqa: F401: a fixture
from official import VALID, asset, call

COUNT = 1_000 if os.environ.get("LEDGERLINE_LONG") == "1" else 50
CHANGES_EACH = 10
TOGETHER = 10  # transactions that are submitted at once, so that blocks hold several
FORGERIES = ("result", "unendorsed")  # which peers call invalid


def send(node, chance: random.Random) -> list[dict]:
    """Calls of one member at once, of random sizes; some are changed behind the endorsement."""
    organisation = chance.choice(ORGANISATIONS)
    calls = []
    for _ in range(TOGETHER):
        name, data = f"Org{organisation}MSP/many{chance.randrange(20)}", chance.randbytes(chance.randrange(2_000))
        forgery = {"how": chance.choice(FORGERIES)} if chance.random() < 0.25 else {}
        calls.append({**call("set", asset(name, data)), **forgery})
    return [{**one, "organisation": organisation} for one in node.user(organisation, "User1").ask("together", calls=calls)["all"]]


def changed(receipt: bytes, chance: random.Random) -> bytes:
    """Any change of its bytes."""
    while True:
        at, length = chance.randrange(len(receipt)), chance.randrange(1, 64)
        before, there, behind = receipt[:at], receipt[at:at + length], receipt[at + length:]
        other = chance.randrange(len(receipt))
        bent = chance.choice([
            lambda: before + bytes([receipt[at] ^ 1 << chance.randrange(8)]) + receipt[at + 1:],
            lambda: before + behind,
            lambda: before + chance.randbytes(length) + receipt[at:],
            lambda: before + chance.randbytes(len(there)) + behind,
            lambda: before + receipt[other:other + length] + receipt[at:],
            lambda: before + receipt[other:other + len(there)] + behind,
            lambda: before])()
        if bent != receipt:
            return bent


def test_random_receipts_verify_in_an_empty_root_and_changed_ones_do_not(tmp_path, ledger, node, empty_root):
    chance = random.Random(20)
    sent = [one for _ in range(COUNT // TOGETHER) for one in send(node, chance)]

    def made(one: dict) -> bytes:
        folder = tmp_path / one["tx"]
        folder.mkdir()
        return make(ledger, folder, one["tx"])

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        receipts = list(pool.map(made, sent))
    code, proven = empty_root.verify_all(receipts)
    assert code == 0, [one for one in proven if not one["proven"]][:3]
    for one, said in zip(sent, proven):
        assert said["proven"] and said["creator"]["msp_id"] == f"Org{one['organisation']}MSP"
        assert (said["transaction"], said["code"], said["block"]) == (one["tx"], one["code"], one["block"])
    valid = sum(one["code"] == VALID for one in sent)
    assert len(sent) // 2 < valid < len(sent)

    refused = 0
    for receipt in range(0, COUNT, TOGETHER):
        bent = [changed(one, chance) for one in receipts[receipt:receipt + TOGETHER] for _ in range(CHANGES_EACH)]
        code, said = empty_root.verify_all(bent)
        assert code == 1 and not any(one["proven"] for one in said), [one for one in said if one["proven"]]
        refused += len(said)
    assert refused == CHANGES_EACH * COUNT
    print(f"{ledger.name}: {COUNT} receipts proven in an empty root, {valid} of them of valid transactions; {refused} changed ones not")
