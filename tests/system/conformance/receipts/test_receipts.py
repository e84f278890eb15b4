"""Receipts: made on either ledger, checked where there is no network, no config and no other file."""
import json

from empty_root import ORGANISATIONS, config, empty_root, make, run  # noqa: F401: a fixture
from ledgers import Authority
from official import MVCC_READ_CONFLICT, asset, call


def test_a_valid_transaction_is_proven_in_an_empty_root(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    receipt = make(ledger, tmp_path, sent["tx"])
    proven = empty_root.proven(receipt)
    assert proven["proven"] and proven["verdict"] == "VALID" and proven["code"] == 0
    assert (proven["transaction"], proven["block"], proven["channel"]) == (sent["tx"], sent["block"], "teleop")
    assert [peer["msp_id"] for peer in proven["peers"]] == [f"Org{k}MSP" for k in ORGANISATIONS]
    assert proven["creator"]["msp_id"] == "Org1MSP" and "CN=User1@org1.ledgerline" in proven["creator"]["subject"]
    assert (proven["contract"], proven["function"], proven["arguments"]) == ("ledgerline", "set", 1)
    assert [orderer["msp_id"] for orderer in proven["orderers"]] == ["OrdererMSP"]
    words = empty_root.verify(receipt).stdout
    assert f"is in block {sent['block']} (" in words and "verdict: VALID, by the word of peers of 3 of 3 organisations" in words


def test_an_invalid_transaction_is_proven_invalid(tmp_path, ledger, enroll, operator, empty_root):
    enroll("receipted")
    operator.submit("stop", "receipted")
    late = operator.call("late", "stop", "receipted", between=call("clear_stop", "receipted"))
    assert late["code"] == MVCC_READ_CONFLICT, late
    proven = empty_root.proven(make(ledger, tmp_path, late["tx"]))
    assert proven["verdict"] == "MVCC_READ_CONFLICT" and proven["function"] == "stop"
    assert proven["creator"]["msp_id"] == "Org2MSP"


def test_what_was_changed_or_is_too_little_proves_nothing(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    receipt = make(ledger, tmp_path, sent["tx"])
    for at in range(0, len(receipt), len(receipt) // 40):
        changed = bytearray(receipt)
        changed[at] ^= 1
        done = empty_root.verify(bytes(changed))
        assert done.returncode == 1 and "nothing is proven: " in done.stderr and not done.stdout, (at, done)
    refused = empty_root.verify(receipt[:-1], "--json")
    assert refused.returncode == 1 and json.loads(refused.stdout) == {"proven": False, "why": "it is cut off or damaged"}
    lone = make(ledger, tmp_path, sent["tx"], peers=(2,))
    done = empty_root.verify(lone)
    assert done.returncode == 1 and "by peers of 1 of 3 organisations, which is no majority" in done.stderr


def test_only_the_checker_decides_whom_to_trust(tmp_path, ledger, drone_host, empty_root):
    receipt = make(ledger, tmp_path, drone_host.submit("set", asset("tello1/receipt"))["tx"])
    trust = empty_root.trust
    other_channel = [word.replace("teleop", "other") for word in trust]
    assert "of channel teleop, not of other" in empty_root.verify(receipt, trust=other_channel).stderr
    swapped = [word.replace("org1.pem", "org3.pem") for word in trust]
    assert "its creator is nobody of the organisations that you named" in empty_root.verify(receipt, trust=swapped).stderr
    no_orderers = [word.replace("orderers.pem", "org1.pem") for word in trust]
    assert "no orderer that you named" in empty_root.verify(receipt, trust=no_orderers).stderr
    for too_little in (trust[:2], trust[2:], trust[:-2], []):
        assert empty_root.verify(receipt, trust=too_little).returncode == 2


def test_the_answer_of_a_revoked_peer_does_not_count_once_its_list_is_given(tmp_path, ledger, drone_host, empty_root):
    receipt = make(ledger, tmp_path, drone_host.submit("set", asset("tello1/receipt"))["tx"], peers=(2, 3))
    assert "no revocation list was given" in empty_root.verify(receipt).stdout
    revoking = Authority(ledger, 2, tmp_path / "revoking")
    peer = next((ledger.organisation(2) / "peers" / "peer0.org2.ledgerline" / "msp" / "signcerts").iterdir())
    (empty_root.root / "peer.crl").write_text(revoking.revoke(peer))
    done = empty_root.verify(receipt, "--crl", "/peer.crl")
    assert done.returncode == 1 and "peers of 1 of 3 organisations, which is no majority; revoked, so not counted: Org2MSP" in done.stderr
    all_three = make(ledger, tmp_path, drone_host.submit("set", asset("tello1/receipt"))["tx"])
    done = empty_root.verify(all_three, "--crl", "/peer.crl")
    assert done.returncode == 0, done.stderr
    assert "by the word of peers of 2 of 3 organisations: Org1MSP" in done.stdout and "revoked, so its word was not counted" in done.stdout
    assert "Org2MSP's of 2" in done.stdout and "none was given of: OrdererMSP, Org1MSP, Org3MSP" in done.stdout
    (empty_root.root / "damaged.crl").write_text((empty_root.root / "peer.crl").read_text()[:200])
    for list_file in ("damaged.crl", "org1.pem"):
        done = empty_root.verify(receipt, "--crl", f"/{list_file}")
        assert done.returncode == 1 and f"/{list_file}: " in done.stderr and not done.stdout, done


def test_several_are_checked_at_once_and_one_that_proves_nothing_is_named(tmp_path, ledger, drone_host, empty_root):
    receipt = make(ledger, tmp_path, drone_host.submit("set", asset("tello1/receipt"))["tx"])
    for name, content in (("good", receipt), ("bad", receipt[:-1])):
        (empty_root.root / name).write_bytes(content)
    done = empty_root.run("--verify", "/good", "/bad", "/good", *empty_root.trust)
    lines = done.stdout.splitlines()
    assert done.returncode == 1 and "of 3 receipts 1 prove nothing" in done.stderr
    assert lines[0] == lines[2] and lines[0].startswith("/good: proven: transaction ") and len(lines) == 3
    assert lines[1] == "/bad: nothing is proven: it is cut off or damaged"
    assert empty_root.run("--verify", "/good", "/good", *empty_root.trust).returncode == 0


def test_it_is_checked_before_it_is_written_where_that_is_asked_for(tmp_path, ledger, drone_host, empty_root):
    sent = drone_host.submit("set", asset("tello1/receipt"))
    trust = [word.replace("=/", f"={empty_root.root}/") for word in empty_root.trust]
    done = run(tmp_path, "--config", config(ledger, tmp_path, 1, peers=(1, 2)), sent["tx"], *trust)
    assert done.returncode == 0 and "peers of 2 of 3 organisations" in done.stdout, done.stderr
    assert empty_root.proven((tmp_path / f"{sent['tx']}.receipt").read_bytes())["transaction"] == sent["tx"]
    lone = run(tmp_path, "--config", config(ledger, tmp_path, 1, peers=(1,)), sent["tx"], *trust, "--out", "lone")
    assert lone.returncode == 1 and "no majority" in lone.stderr and not (tmp_path / "lone").exists()


def test_there_is_none_of_what_is_not_on_the_ledger(tmp_path, ledger):
    done = run(tmp_path, "--config", config(ledger, tmp_path, 1), "ab" * 32)
    assert done.returncode == 1 and "ab" * 32 in done.stderr and not list(tmp_path.glob("*.receipt"))
    for words in ((), ("ab" * 32,), ("xyz", "--config", tmp_path / "org1.toml"), ("--verify", tmp_path / "none")):
        assert run(tmp_path, *words).returncode == 2, words
