"""Fabric's own command line, `peer`, on both ledgers."""
import hashlib
import json

import pytest
from cli import good, invoke, on_contract, peer_of, query
from official import asset, decode, message


def test_it_invokes_and_queries_the_contract(peer, drone_host):
    done = invoke(peer, "set", json.dumps(asset("tello1/cli")), more=("--waitForEvent",))
    assert done.returncode == 0, done.stderr
    assert "committed with status (VALID)" in done.stderr
    read = query(peer, "get", "tello1/cli")
    assert read.returncode == 0, read.stderr
    assert json.loads(read.stdout) == drone_host.read("get", "tello1/cli")


def test_an_answer_of_the_contract_is_shown(peer, ledger, enroll):
    enroll("clidrone")
    operator = peer_of(ledger, 2, "User1")
    done = invoke(operator, "acquire", "clidrone", more=("--waitForEvent",))
    assert done.returncode == 0 and "Chaincode invoke successful. result: status:200 payload:" in done.stderr
    assert "clidrone" in done.stderr
    assert invoke(operator, "release", "clidrone", more=("--waitForEvent",)).returncode == 0


def test_a_refusal_is_shown_with_the_contracts_message(peer, ledger):
    for done in (query(peer, "get", "tello1/never"), invoke(peer, "delete", "tello1/never")):
        assert done.returncode == 1
        assert "tello1/never: not found" in done.stderr
    outsider = query(peer_of(ledger, 1, "User1", msp_id="Org2MSP"), "get")
    assert outsider.returncode == 1 and "access denied" in outsider.stderr


def test_an_invoke_needs_an_orderers_address(peer):
    done = peer.run("chaincode", "invoke", *peer.ordering[2:], *on_contract("get"))
    assert done.returncode == 1 and "orderer endpoint" in done.stderr


def test_it_shows_height_and_hash_of_the_chain(peer, drone_host, nobody):
    end = drone_host.submit("set", asset("tello1/height"))["block"] + 1
    info = json.loads(good(peer, "channel", "getinfo", "-c", "teleop").split("Blockchain info: ")[1].splitlines()[0])
    assert info["height"] == end
    after = drone_host.submit("set", asset("tello1/height"))["block"]
    (block,) = nobody.ask("blocks", start=after, count=1)["blocks"]
    assert info["currentBlockHash"] == block["previous"]
    assert "teleop" in good(peer, "channel", "list").splitlines()
    wrong = peer.run("channel", "getinfo", "-c", "nowhere")
    assert wrong.returncode == 1 and "Invalid chain ID, nowhere" in wrong.stderr


@pytest.mark.parametrize("source", ["peer", "orderer"])
def test_it_fetches_blocks(peer, drone_host, nobody, tmp_path, source):
    ordering = peer.ordering if source == "orderer" else []
    newest = drone_host.submit("set", asset("tello1/fetched"))["block"]

    def fetch(what) -> tuple[int, dict]:
        path = tmp_path / "block"
        good(peer, "channel", "fetch", what, path, "-c", "teleop", *ordering)
        parts = message(path.read_bytes())
        header = parts[1][0]
        number = 0 if header[0] != 8 else int.from_bytes(bytes([header[1]]), "little")
        assert hashlib.sha256(b"".join(message(parts[2][0])[1])).digest() == message(header)[3][0]
        return number, parts

    assert fetch("oldest")[0] == 0
    assert fetch(1)[0] == 1
    (block,) = nobody.ask("blocks", start=newest, count=1)["blocks"]
    assert message(fetch("newest")[1][1][0])[3] == [decode(block["dataHash"])]
    # The last config block is the first block: nothing has changed since.
    assert fetch("config")[0] == 0


def test_the_gateway_client_asks_the_peers_own_contract_too(drone_host):
    written = drone_host.submit("set", asset("tello1/asked"))

    def ask(function: str, *args):
        return drone_host.call("evaluate", function, "teleop", *args, contract="qscc")

    block = decode(ask("GetBlockByNumber", str(written["block"]))["result"])
    assert block == decode(ask("GetBlockByTxID", written["tx"])["result"])
    (envelope,) = message(message(block)[2][0])[1]
    transaction = decode(ask("GetTransactionByID", written["tx"])["result"])
    assert message(transaction) == {1: [envelope]}  # its flag, 0, is not written
    assert message(decode(ask("GetChainInfo")["result"]))[3] == message(message(block)[1][0])[2]
    for question in (("GetBlockByNumber", "1000000"), ("GetTransactionByID", "none"), ("Nothing", "x")):
        assert ask(*question)["error"]["details"][0].startswith("chaincode response 500, ")
