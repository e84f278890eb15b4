"""Ground and the bridge, which keep their place in the chain alone, as they start again."""
import contextlib
import json
import shutil
import stat
import subprocess
import time

import pytest
from ledgers import Embedded, tables
from programs import BIN
from test_checkpoint import TIMEOUT_S, grow, height_of, submit

TOPIC = '[[topic]]\nname = "/note"\ntype = "std_msgs/msg/String"\ndirection = "to_ledger"\n'
GROUND = '[flight]\nshape = "manual"\n[[drone]]\nname = "tello1"\n'


class Follower:
    """A program that follows the chain, its config and what it leaves behind. It writes nothing to the ledger."""

    def __init__(self, folder, program: str, more: str):
        self.folder, self.program, self.more = folder, program, more
        self.checkpoint, self.log_file = folder / f"{program}.checkpoint", folder / f"{program}.log"

    def start(self, ledger) -> subprocess.Popen:
        config = self.folder / f"{self.program}.{ledger.directory.name}.toml"
        config.write_text(f'{tables(ledger, 2)}[output]\ncheckpoint = "{self.checkpoint}"\n{self.more}')
        command = [BIN / f"ledgerline-{self.program}", *(["--config"] if self.program == "ground" else []), config]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    @contextlib.contextmanager
    def running(self, ledger):
        with open(self.log_file, "w") as log:
            process = self.start(ledger)
            line = process.stdout.readline()
            with contextlib.ExitStack() as at_end:
                at_end.callback(process.kill)
                assert line and json.loads(line)["ready"], process.communicate(timeout=TIMEOUT_S)[1]
                yield process
                process.terminate()
                log.write(process.communicate(timeout=TIMEOUT_S)[1])
        assert process.returncode == 0, self.log()

    def see_a_block(self, ledger) -> None:
        """Until it is in the file."""
        before = self.kept()
        submit(ledger)
        until = time.monotonic() + TIMEOUT_S
        while self.kept() == before:
            assert time.monotonic() < until, "no block is kept"
            time.sleep(0.02)

    def kept(self) -> bytes:
        return self.checkpoint.read_bytes() if self.checkpoint.exists() else b""

    def log(self) -> str:
        return self.log_file.read_text()

    def block(self, file=None) -> int:
        return int((file or self.checkpoint).read_bytes().split(b"\n")[2].split()[1])


@pytest.fixture(params=["ground", "bridge"])
def follower(request, tmp_path) -> Follower:
    return Follower(tmp_path, request.param, GROUND if request.param == "ground" else TOPIC)


@pytest.fixture
def directory(tmp_path):
    """Of a ledger that has some blocks."""
    grow(tmp_path / "ledger", 20)
    return tmp_path / "ledger"


@contextlib.contextmanager
def ledger_in(directory):
    ledger = Embedded(directory)
    try:
        yield ledger
    finally:
        ledger.stop()


def test_what_came_meanwhile_is_a_gap_that_the_log_names(follower, directory):
    with ledger_in(directory) as ledger, follower.running(ledger):
        follower.see_a_block(ledger)
    assert "there is no checkpoint yet" in follower.log()
    assert stat.S_IMODE(follower.checkpoint.stat().st_mode) == 0o600
    verified = follower.block()
    assert verified == height_of(directory) - 1
    with ledger_in(directory) as ledger, follower.running(ledger):
        pass
    assert "are not read" not in follower.log() and follower.block() == verified, "nothing came"
    grow(directory, height_of(directory) + 3_000)
    with ledger_in(directory) as ledger:
        begin = time.monotonic()
        with follower.running(ledger):
            assert time.monotonic() - begin < 2
        assert follower.block() == verified + 3_000, "though no block has come"
        assert f"blocks {verified + 1} to {verified + 3_000} came while this program was away" in follower.log()
        with follower.running(ledger):
            follower.see_a_block(ledger)


def test_an_old_chain_and_a_fork_are_refused(tmp_path, directory):
    old, fork = tmp_path / "old", tmp_path / "fork"
    for copy in (old, fork):
        shutil.copytree(directory, copy)
    grow(directory, height_of(directory) + 10)
    grow(fork, height_of(fork) + 20)
    followers = [Follower(tmp_path, "ground", GROUND), Follower(tmp_path, "bridge", TOPIC)]
    with ledger_in(directory) as ledger:
        for each in followers:
            with each.running(ledger):
                each.see_a_block(ledger)
    kept = [each.kept() for each in followers]
    end_of_old = height_of(old) - 1
    with ledger_in(old) as older, ledger_in(fork) as forked:
        started = [(each, lie, each.start(lie)) for each in followers for lie in (older, forked)]
        for each, lie, process in started:
            out, log = process.communicate(timeout=TIMEOUT_S)
            assert process.returncode == (3 if each.program == "ground" else 1) and out == "", f"{each.program} became ready: {log}"
            words = (f"serves a chain that ends at block {end_of_old}; we have verified block {each.block()}"
                     if lie is older else f"serves another block {each.block()} than the one that we have verified")
            assert words in log
    assert [each.kept() for each in followers] == kept


def spoil(file) -> None:
    spoilt = bytearray(file.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    file.write_bytes(spoilt)


def test_a_damaged_checkpoint_is_never_silently_none(follower, directory):
    with ledger_in(directory) as ledger:
        with follower.running(ledger):
            follower.see_a_block(ledger)
        spoil(follower.checkpoint)
        process = follower.start(ledger)
        out, log = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 2 and out == ""
        assert f"{follower.checkpoint}: it is damaged" in log and "then remove the file" in log
        follower.checkpoint.unlink()
        with follower.running(ledger):
            pass


def test_the_bridge_beside_a_program_keeps_a_file_of_its_own_and_its_damage_grounds_nobody(tmp_path, directory):
    ground = Follower(tmp_path, "ground", GROUND + TOPIC)
    beside = tmp_path / "ground.checkpoint.bridge"
    with ledger_in(directory) as ledger:
        with ground.running(ledger):
            until = time.monotonic() + TIMEOUT_S
            while not beside.exists():
                assert time.monotonic() < until
                submit(ledger)
        assert abs(ground.block() - ground.block(beside)) <= 1
        spoil(beside)
        with ground.running(ledger):
            ground.see_a_block(ledger)
    assert f"the bridge starts again: output.checkpoint: {beside}: it is damaged" in ground.log()
