"""An agent that starts again, at a ledger that has grown, lags behind, was forked, or whose checkpoint is spoilt; and one
whose records another organisation's peer tells otherwise."""
import base64
import contextlib
import json
import os
import shutil
import stat
import subprocess
import time

import pytest
from ledgers import Embedded, tables
from programs import BIN

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
ABSENCE = 100_000 if LONG else 3_000
TIMEOUT_S = 60


def grow(directory, height: int) -> None:
    subprocess.run([BIN / "grow_chain", "--dir", directory, "--height", str(height)], check=True, timeout=800,
                   stdout=subprocess.DEVNULL)


def height_of(directory) -> int:
    grown = subprocess.run([BIN / "grow_chain", "--dir", directory, "--height", "0"], check=True, timeout=60,
                           capture_output=True, text=True)
    return int(grown.stdout.splitlines()[-1])


@pytest.fixture(scope="module", autouse=True)
def roudi():
    process = subprocess.Popen([BIN / "ledgerline-roudi"], stdout=subprocess.PIPE, text=True)
    assert json.loads(process.stdout.readline())["ready"]
    yield
    process.terminate()
    process.wait(timeout=TIMEOUT_S)


class Host:
    """A drone's host: its ledger's directory, its agent's config and what the agent leaves behind."""

    def __init__(self, folder):
        self.folder, self.directory = folder, folder / "ledger"
        self.checkpoint, self.log, self.summary = folder / "agent.checkpoint", folder / "agent.log", folder / "agent.json"
        grow(self.directory, 20)

    def write_config(self, ledger, more: str, witness=None) -> None:
        where = tables(ledger, 1)
        if witness:
            where += '[[endorser]]\nmsp_id = "Org2MSP"\nendpoint = "{}"\ntls_ca = "{}"\n'.format(*witness.endorser(2))
        (self.folder / "agent.toml").write_text(
            f'{where}[mocap]\ntopic = ""\n[output]\nsummary = "{self.summary}"\ncheckpoint = "{self.checkpoint}"\n'
            f'[agent]\nstart_wait_s = 2\nrecheck_s = 1\n{more}'
            '[[drone]]\nname = "tello1"\n')

    @contextlib.contextmanager
    def ledger(self, directory=None, more: str = ""):
        ledger = Embedded(directory or self.directory)
        try:
            self.write_config(ledger, more)
            yield ledger
        finally:
            ledger.stop()

    def run_agent(self, ledger=None) -> tuple[float, str]:
        """Until it is ready, and, where a ledger is named, has seen a block more; then it ends. Seconds to its start, its log."""
        begin = time.monotonic()
        with open(self.log, "w") as log:
            agent = subprocess.Popen([BIN / "ledgerline-agent", "--config", self.folder / "agent.toml"],
                                     stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            line = agent.stdout.readline()
            took_s = time.monotonic() - begin
            assert '"ready":true' in line, self.log.read_text()
            if ledger:
                before = self.checkpoint.read_bytes() if self.checkpoint.exists() else b""
                submit(ledger)
                until = time.monotonic() + TIMEOUT_S
                while (self.checkpoint.read_bytes() if self.checkpoint.exists() else b"") == before:
                    assert time.monotonic() < until, self.log.read_text()
                    time.sleep(0.02)
        finally:
            agent.terminate()
            assert agent.wait(timeout=TIMEOUT_S) == 0, self.log.read_text()
        return took_s, self.log.read_text()

    def refused(self) -> tuple[int, str]:
        ended = subprocess.run([BIN / "ledgerline-agent", "--config", self.folder / "agent.toml"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, timeout=TIMEOUT_S)
        assert ended.stdout == "", "it must not have become ready"
        return ended.returncode, ended.stderr

    def block(self) -> int:
        return int(self.checkpoint.read_bytes().split(b"\n")[2].split()[1])


def submit(ledger, organisation: int = 1, function: str = "set",
           argument: str = '{"assets":[{"id":"Org1MSP/note","msgType":"t","msgData":"AAAA"}]}') -> None:
    endpoint, ca = ledger.peer(1)
    subprocess.run([BIN / "client_example", endpoint, ca, f"Org{organisation}MSP", ledger.msp_dir(organisation, "User1"),
                    "submit", function, argument], check=True, timeout=60, stdout=subprocess.DEVNULL)


def alarm_on(ledger) -> bytes:
    """The newest of tello1's agent, as soon as there is one."""
    endpoint, ca = ledger.peer(1)
    until = time.monotonic() + TIMEOUT_S
    while True:
        read = subprocess.run([BIN / "client_example", endpoint, ca, "Org1MSP", ledger.msp_dir(1, "User1"), "evaluate", "get",
                               "tello1/alarm"], timeout=60, capture_output=True, text=True)
        if read.returncode == 0:
            return base64.b64decode(json.loads(read.stdout[read.stdout.index("{"):])["msgData"])
        assert time.monotonic() < until, read.stderr
        time.sleep(0.1)


@pytest.fixture
def host(tmp_path) -> Host:
    """Whose agent was there once, at its ledger's end."""
    host = Host(tmp_path)
    with host.ledger() as ledger:
        _, log = host.run_agent(ledger)
    assert "there is no checkpoint yet" in log
    assert stat.S_IMODE(host.checkpoint.stat().st_mode) == 0o600
    assert host.block() == height_of(host.directory) - 1
    return host


def test_a_restart_goes_on_behind_the_checkpoint_and_misses_no_block(host):
    verified = host.block()
    grow(host.directory, height_of(host.directory) + 500)
    with host.ledger():
        _, log = host.run_agent()
    assert f"goes on behind block {verified}, which was verified; the chain is at {verified + 500}" in log
    summary = json.loads(host.summary.read_text())
    assert summary["blocks"] == 500 and summary["blocks_not_read"] == 0 and summary["control_events_refused"] == 0
    assert host.block() == verified + 500, "kept at the orderly end"


def test_a_restart_after_a_long_absence_reads_neither_all_blocks_nor_takes_long(host):
    verified = host.block()
    grow(host.directory, height_of(host.directory) + ABSENCE)
    with host.ledger() as ledger:
        took_s, log = host.run_agent(ledger)
    print(f"ready {took_s:.2f} s after {ABSENCE} blocks of absence")
    assert took_s < 2
    assert f"blocks {verified + 1} to {verified + ABSENCE} came while this program was away" in log
    assert "counts by its orderers' signatures" in log
    summary = json.loads(host.summary.read_text())
    assert summary["blocks_not_read"] == ABSENCE and summary["blocks"] < 10
    assert host.block() > verified + ABSENCE


def test_behind_a_gap_two_organisations_peers_must_tell_the_same_records(host, tmp_path):
    shutil.copytree(host.directory, tmp_path / "other")
    grow(host.directory, height_of(host.directory) + 10)
    gap = "max_absence_blocks = 0\n"
    kept = host.checkpoint.read_bytes()
    with host.ledger(more=gap) as ledger:
        host.write_config(ledger, gap, ledger)
        _, log = host.run_agent()
        assert "another organisation's peer reports the same control records" in log

        host.checkpoint.write_bytes(kept)
        host.write_config(ledger, gap)
        _, log = host.run_agent()
        assert "control records rest on our own peer alone" in log, "and it goes on"

        host.checkpoint.write_bytes(kept)
        other = Embedded(tmp_path / "other")
        try:
            submit(ledger, 2, "acquire", '{"drones":["tello1"]}')
            host.write_config(ledger, gap, other)
            code, log = host.refused()
            assert code == 1
            assert "two organisations' peers must report the same control records, and do not: tello1: here held by Org2MSP" in log
            assert "at another organisation's peer not held" in log
            other.stop()
            code, log = host.refused()
            assert code == 1 and "another organisation's peer does not report the control records" in log
            assert host.checkpoint.read_bytes() == kept
        finally:
            other.stop()


def test_a_peer_that_serves_an_old_chain_is_refused(host, tmp_path):
    old = tmp_path / "old"
    shutil.copytree(host.directory, old)
    grow(host.directory, height_of(host.directory) + 10)
    with host.ledger():
        host.run_agent()
    verified, kept = host.block(), host.checkpoint.read_bytes()
    with host.ledger(old):
        code, log = host.refused()
    assert code == 1
    assert f"serves a chain that ends at block {verified - 10}; we have verified block {verified}" in log
    assert "the ledger is not trusted, stream_contradicted" in log, "a peer that lags for so long is reported as not trusted"
    assert host.checkpoint.read_bytes() == kept


@pytest.mark.parametrize("more", ["", "max_absence_blocks = 0\n"])
def test_a_fork_that_the_same_orderers_signed_is_refused(host, tmp_path, more):
    fork = tmp_path / "fork"
    shutil.copytree(host.directory, fork)
    grow(host.directory, height_of(host.directory) + 10)
    grow(fork, height_of(fork) + 20)
    with host.ledger():
        host.run_agent()
    verified, kept = host.block(), host.checkpoint.read_bytes()
    with host.ledger(fork, more):
        code, log = host.refused()
    assert code == 1
    assert f"serves another block {verified} than the one that we have verified" in log
    assert "the ledger is not trusted, stream_contradicted" in log
    assert host.checkpoint.read_bytes() == kept


def test_a_damaged_checkpoint_is_never_silently_none(host):
    spoilt = bytearray(host.checkpoint.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    host.checkpoint.write_bytes(spoilt)
    with host.ledger():
        code, log = host.refused()
        assert code == 2 and f"{host.checkpoint}: it is damaged" in log and "then remove the file" in log
        host.checkpoint.unlink()
        host.run_agent()


def test_an_agent_that_is_killed_goes_on_from_what_it_had_written(host):
    with host.ledger() as ledger:
        with open(host.log, "w") as log:
            agent = subprocess.Popen([BIN / "ledgerline-agent", "--config", host.folder / "agent.toml"],
                                     stdout=subprocess.PIPE, stderr=log, text=True)
        assert '"ready":true' in agent.stdout.readline()
        before = host.block()
        submit(ledger)
        until = time.monotonic() + TIMEOUT_S
        while host.block() == before and time.monotonic() < until:
            time.sleep(0.02)
        agent.kill()
        agent.wait()
        _, log = host.run_agent()
    assert f"goes on behind block {before + 1}" in log


class Running:
    """An agent that runs, and what it says."""

    def __init__(self, host: Host):
        self.host = host
        with open(host.log, "w") as log:
            self.process = subprocess.Popen([BIN / "ledgerline-agent", "--config", host.folder / "agent.toml"],
                                            stdout=subprocess.PIPE, stderr=log, text=True)

    def __enter__(self):
        assert '"ready":true' in self.process.stdout.readline(), self.host.log.read_text()
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(timeout=TIMEOUT_S)

    def wait_for(self, words: str) -> None:
        until = time.monotonic() + TIMEOUT_S
        while words not in self.host.log.read_text():
            assert time.monotonic() < until, self.host.log.read_text()
            time.sleep(0.02)


ALARM = "tello1: another organisation's peer reports another record than this agent trusts"


def test_records_that_two_organisations_peers_tell_alike_are_no_alarm(host):
    with host.ledger() as ledger:
        host.write_config(ledger, "", ledger)
        with Running(host):
            for function in ("acquire", "release") * 4:  # while they are compared
                submit(ledger, 2, function, '{"drones":["tello1"]}')
                time.sleep(0.5)
    summary = json.loads(host.summary.read_text())
    assert summary["records_compared"] >= 3 and summary["records_differ"] == 0, host.log.read_text()
    assert summary["integrity_violations"] == 0 and summary["alarms"]["on_ledger"] == 0, host.log.read_text()


def test_a_record_that_differs_at_another_organisations_peer_is_an_alarm_until_it_agrees(host, tmp_path):
    shutil.copytree(host.directory, tmp_path / "other")
    with host.ledger() as ledger:
        other = Embedded(tmp_path / "other")
        try:
            host.write_config(ledger, "", other)
            with Running(host) as agent:
                submit(ledger, 2, "acquire", '{"drones":["tello1"]}')
                agent.wait_for(ALARM)
                assert "held by Org2MSP" in host.log.read_text() and "there not held" in host.log.read_text()
                agent.wait_for("the ledger is not trusted, records_differ (1 of 1 since the last word): tello1: here held by Org2MSP")
                assert b"tello1/alarm/records_differ" in alarm_on(ledger)
                submit(ledger, 2, "release", '{"drones":["tello1"]}')
                submit(other, 2, "acquire", '{"drones":["tello1"]}')
                submit(other, 2, "release", '{"drones":["tello1"]}')
                agent.wait_for("tello1: another organisation's peer reports the same record again")
            summary = json.loads(host.summary.read_text())
            assert summary["records_differ"] == 1 and summary["integrity_violations_by_kind"] == {"records_differ": 1}
            other.stop()
            with Running(host) as agent:
                agent.wait_for("the control records of another organisation's peer cannot be read")
            assert json.loads(host.summary.read_text())["records_differ"] == 0
        finally:
            other.stop()
