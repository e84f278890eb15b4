"""A stop loses to nobody: on the embedded node and on Fabric itself."""
import json
import pathlib
import subprocess
import time

import pytest
from fabric import BIN
from ledgers import Embedded
from official import MVCC_READ_CONFLICT, PHANTOM_READ_CONFLICT, VALID, call

STOPPERS = 10
BLOCKS = 5
TRIES = 20


def guards(authority, node, admin) -> list[dict]:
    """Operators of the drones' organisation, each with a certificate of its own."""
    issued = [authority.issue(f"Guard{number}", authority.begin() + 1, time.time() + 3600) for number in range(STOPPERS)]
    for number in range(STOPPERS):
        who = {"mspId": "Org1MSP", "subject": f"CN=Guard{number}@org1.ledgerline,OU=client,O=org1.ledgerline"}
        admin(1).submit("enroll", {"identity": who, "role": "OPERATOR"})
    return issued


def config(ledger, folder: pathlib.Path, name: str, msp_id: str, msp_dir: pathlib.Path) -> pathlib.Path:
    endpoint, ca_file = ledger.peer(int(msp_id[3]))
    path = folder / f"{name}.toml"
    path.write_text(f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca_file}"\nmsp_id = "{msp_id}"\nmsp_dir = "{msp_dir}"\n')
    return path


def msp_of(identity: dict, folder: pathlib.Path) -> pathlib.Path:
    for part, what in (("signcerts", "certificate"), ("keystore", "key")):
        (folder / part).mkdir(parents=True)
        file = folder / part / ("cert.pem" if part == "signcerts" else "priv_sk")
        file.touch(0o600)
        file.write_text(identity[what])
    return folder


def test_ten_stops_are_on_the_ledger_within_five_blocks_whatever_a_holder_does_in_a_loop(
        tmp_path, ledger, node, admin, authority, enroll, operator):
    enroll("besieged")
    enroll(organisation=2, user="User2", role="OPERATOR")
    operator.submit("acquire", "besieged")
    stoppers = [config(ledger, tmp_path, f"guard{number}", "Org1MSP", msp_of(one, tmp_path / f"msp{number}"))
                for number, one in enumerate(guards(authority, node, admin))]
    holder, rival = (config(ledger, tmp_path, user, "Org2MSP", ledger.msp_dir(2, user)) for user in ("User1", "User2"))
    done = subprocess.run([BIN / "test_stops", "--stopper", *stoppers, "--holder", holder, "--rival", rival,
                           "--drone", "besieged"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    print(result)
    assert len(result["stops"]) == STOPPERS
    assert all(stop["on_ledger"] and stop["attempts"] == 1 for stop in result["stops"]), result
    assert max(stop["blocks"] for stop in result["stops"]) <= BLOCKS, result


@pytest.fixture
def own_ledger(tmp_path):
    """One that may be killed, with the operator of tello1's lease: its config."""
    node = Embedded(tmp_path / "own")
    operator = config(node, tmp_path, "operator", "Org2MSP", node.msp_dir(2, "User1"))
    assert control(operator, "acquire", "tello1").wait(timeout=60) == 0
    yield node, operator
    assert node.stop() == 0, node.log()


def control(path: pathlib.Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen([BIN / "ledgerline", "control", "--config", path, *words], stdout=subprocess.PIPE,
                            stderr=subprocess.STDOUT, text=True)


def test_a_stop_that_finds_no_ledger_is_repeated_until_there_is_one(own_ledger):
    node, operator = own_ledger
    node.kill()
    stop = control(operator, "stop", "tello1")
    assert "said again until it is on the ledger" in stop.stdout.readline()
    node.start()
    printed = stop.communicate(timeout=60)[0]
    assert stop.returncode == 0, printed
    assert json.loads(printed.splitlines()[-1])["stops"][0]["drone"] == "tello1"


def test_a_stop_is_given_up_after_its_time_and_a_refused_one_at_once(own_ledger):
    node, operator = own_ledger
    refused = control(operator, "stop", "tello17")
    printed = refused.communicate(timeout=60)[0]
    assert refused.returncode == 1 and "tello17: not enrolled" in printed and "said again" not in printed
    node.kill()
    stop = control(operator, "stop", "--within", "6", "tello1")
    printed = stop.communicate(timeout=60)[0]
    assert stop.returncode == 1 and "in 6 s" in printed, printed
    node.start()


def test_of_a_stop_and_a_change_in_one_block_the_stop_is_valid(ledger, node, admin, authority, enroll, operator):
    enroll("contested")
    supervisor = enroll(user="User2", role="SUPERVISOR")
    operator.submit("acquire", "contested")
    seen = 0
    for _ in range(TRIES):
        operator.submit("stop", "contested")
        stop, clear = (client.send("submit", **call(fn, "contested"))
                       for client, fn in ((supervisor, "stop"), (operator, "clear_stop")))
        stopped, cleared = supervisor.receive(stop), operator.receive(clear)
        assert stopped["code"] == VALID
        if cleared["code"] != VALID:
            assert cleared["code"] in (MVCC_READ_CONFLICT, PHANTOM_READ_CONFLICT)
            seen += 1
            break
        supervisor.submit("clear_stop", "contested")
    print(seen, "lost to the stop")
    assert seen


def test_each_clears_its_own_stop_and_a_foreign_supervisor_no_other(admin, enroll, operator):
    host, supervisor = enroll("kept"), enroll(user="User2", role="SUPERVISOR")
    outsider = enroll(organisation=3, user="User1", role="SUPERVISOR")
    assert "may not stop it: Org1MSP has granted that neither" in outsider.refusal("stop", "kept")
    admin(1).submit("grant", {"drones": ["kept"], "grant": {"to": {"mspId": "Org3MSP"}, "stop": True}})
    supervisor.submit("stop", "kept")
    assert outsider.refusal("clear_stop", "kept").startswith("kept: stopped by Org1MSP")
    outsider.submit("stop", "kept")
    outsider.submit("clear_stop", "kept")
    assert outsider.refusal("clear_stop", "kept").startswith("kept: stopped by Org1MSP")
    assert "may not cut it" in outsider.refusal("stop", "kept", "cut=true")
    operator.submit("stop", "kept")  # who may fly it may stop it, with or without a lease
    operator.submit("clear_stop", "kept")
    host.submit("apply_stops", "kept")
    supervisor.submit("clear_stop", "kept")


def test_a_stop_that_is_held_back_until_a_clear_does_nothing(enroll, operator):
    enroll("cleared")
    operator.submit("stop", "cleared")
    late = operator.call("late", "stop", "cleared", between=call("clear_stop", "cleared"))
    assert late["code"] == MVCC_READ_CONFLICT, late
    assert "stopped by" not in operator.refusal("clear_stop", "cleared"), "nobody has it stopped"
    assert operator.refusal("stop", {"drones": ["cleared"], "clears": [0]}).startswith(
        "cleared: a stop meant for 0 clears of the stops of Org2MSP"), "an old count"
    operator.submit("stop", {"drones": ["cleared"], "clears": [1]})
    late = operator.call("late", "stop", {"drones": ["cleared"], "clears": [1]}, between=call("clear_stop", "cleared"))
    assert late["code"] == MVCC_READ_CONFLICT, late
