"""A peer of any organisation answers any member of the channel itself, without a gateway."""
import contextlib
import json
import os
import pathlib
import signal
import subprocess

import pytest
from fabric import BIN, processes_in

ORGANISATIONS = (1, 2, 3)


def ask(ledger, folder: pathlib.Path, organisation: int, *words, deadline_ms: int = 20_000) -> subprocess.CompletedProcess:
    """That organisation's peer, as the drone host of the first."""
    endpoint, ca_file = ledger.endorser(organisation)
    config = folder / f"asks-org{organisation}.toml"
    config.write_text(f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca_file}"\nmsp_id = "Org1MSP"\n'
                      f'msp_dir = "{ledger.msp_dir(1, "User1")}"\ndeadline_ms = {deadline_ms}\n')
    return subprocess.run([BIN / "test_ask_peer", "--config", config, *words], capture_output=True, text=True, timeout=60)


def control(ledger, folder: pathlib.Path, organisation: int, drone: str, **more) -> dict:
    done = ask(ledger, folder, organisation, "get", f"control/{drone}", **more)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def until_all_have(ledger, folder: pathlib.Path, drone: str, record: dict) -> None:
    """A peer may be a block behind the one that was asked first."""
    for organisation in ORGANISATIONS:
        for _ in range(50):
            if (reported := control(ledger, folder, organisation, drone)) == record:
                break
        assert reported == record, organisation


@contextlib.contextmanager
def asleep(ledger, organisation: int):
    """Its peer says nothing."""
    pid = processes_in(ledger.directory)[f"peer{organisation}"]["pid"]
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_each_organisations_peer_gives_the_record_to_members_of_others(tmp_path, ledger, enroll, drone_host, operator):
    enroll("reported")
    before = drone_host.read("get", "control/reported")
    until_all_have(ledger, tmp_path, "reported", before)
    operator.submit("acquire", "reported")
    after = drone_host.read("get", "control/reported")
    assert after != before
    until_all_have(ledger, tmp_path, "reported", after)
    for organisation in ORGANISATIONS:
        done = ask(ledger, tmp_path, organisation, "get", "control/nobodys")
        assert done.returncode == 1 and "control/nobodys: not found" in done.stderr, done


def test_nobody_answers_for_a_peer_that_says_nothing(tmp_path, ledger, enroll, drone_host):
    if ledger.name != "fabric":
        pytest.skip("one process is everybody's peer")
    enroll("silenced")
    record = drone_host.read("get", "control/silenced")
    until_all_have(ledger, tmp_path, "silenced", record)
    with asleep(ledger, 3):
        done = ask(ledger, tmp_path, 3, "get", "control/silenced", deadline_ms=2_000)
        assert done.returncode == 1 and not done.stdout, done
        # A new connection's handshake may be given up at the same moment as the call.
        assert "no answer in time" in done.stderr or "not reached" in done.stderr, done.stderr
        for organisation in (1, 2):
            assert control(ledger, tmp_path, organisation, "silenced") == record
    assert control(ledger, tmp_path, 3, "silenced") == record
