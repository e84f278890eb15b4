"""A ledger that is ended or killed goes on where it was."""
import time

import pytest
from official import UNAVAILABLE, VALID, asset


def submit_when_ready(client, *args) -> dict:
    """While Fabric's orderers have no leader, or the peer has not found one, a client has to try again."""
    deadline = time.monotonic() + 20
    while (answer := client.call("submit", *args)).get("error", {}).get("code") == UNAVAILABLE:
        assert time.monotonic() < deadline, answer
        time.sleep(0.1)
    assert answer.get("successful"), answer
    return answer


@pytest.mark.parametrize("how", ["stop", "kill"])
def test_a_ledger_goes_on_where_it_was(ledger, drone_host, nobody, tmp_path, how):
    before = [drone_host.submit("set", asset(f"tello1/restart/{how}/{number}")) for number in range(6)]
    again = drone_host.call("replay", "set", asset(f"tello1/restart/{how}/replayed"))["first"]
    start, checkpoint = before[0]["block"], str(tmp_path / "checkpoint.json")
    first = nobody.ask("checkpointed", start=start, counts=[3], file=checkpoint)["events"]
    blocks = nobody.ask("blocks", start=0, count=again["block"] + 1)["blocks"]

    if how == "kill":
        ledger.kill()
    else:
        assert ledger.stop() == 0, ledger.log()
    ledger.start()

    # Everything that was confirmed is there, byte for byte, and the chain goes on behind it.
    assert nobody.ask("blocks", start=0, count=again["block"] + 1)["blocks"] == blocks
    for number, written in enumerate(before):
        assert nobody.read("get", f"tello1/restart/{how}/{number}")["id"] == f"tello1/restart/{how}/{number}"
        assert nobody.ask("status", tx=written["tx"]) == {"code": VALID, "block": written["block"]}
    newer = submit_when_ready(drone_host, "set", asset(f"tello1/restart/{how}/0", b"newer"))
    assert newer["block"] > again["block"]
    versions = nobody.read("history", f"tello1/restart/{how}/0")["versions"]
    assert [version["txId"] for version in versions] == [newer["tx"], before[0]["tx"]]
    # The listener goes on behind its checkpoint.
    rest = nobody.ask("checkpointed", start=start, counts=[5], file=checkpoint)["events"]
    wanted = [one["tx"] for one in before] + [again["tx"], newer["tx"]]
    assert [event["tx"] for event in first + rest] == wanted
