"""Four drones fly on while an outsider or a member abuses the embedded ledger with a third of a core; beside it the same CPU
is burnt for nothing, which tells the ledger's part from the machine's."""
import json
import os
import pathlib
import subprocess

import pytest
from flights import (BIN, FLYING, HOLD, as_user, assert_nothing_left, fly, no_flight_outlives_its_test, printed, result, wait_for_flight)
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
DRONES = 4
SECONDS = 30  # of abuse
CPU = 0.3     # of a core


class Share:
    """A cgroup whose processes get so much of a core; of version 1 or 2, whichever has the controller."""

    def __init__(self, name: str):
        old, new = pathlib.Path("/sys/fs/cgroup/cpu"), pathlib.Path("/sys/fs/cgroup")
        period_us = 100_000
        quota_us = int(CPU * period_us)
        if (old / "cpu.cfs_quota_us").exists():
            self.group = old / name
            limits = {"cpu.cfs_period_us": period_us, "cpu.cfs_quota_us": quota_us}
        elif "cpu" in (new / "cgroup.controllers").read_text().split():
            self.group = new / name
            with open(new / "cgroup.subtree_control", "w") as control:
                control.write("+cpu")
            limits = {"cpu.max": f"{quota_us} {period_us}"}
        else:
            pytest.skip("no cgroup controller for CPU: abuse cannot be bounded to a third of a core")
        self.group.mkdir()
        for file, value in limits.items():
            (self.group / file).write_text(str(value))

    def run(self, *command) -> subprocess.CompletedProcess:
        return subprocess.run(["sh", "-c", 'echo $$ >"$0/cgroup.procs" && exec "$@"', self.group, *command], capture_output=True,
                              text=True, check=True, timeout=SECONDS + 60)

    def close(self) -> None:
        self.group.rmdir()


@pytest.fixture
def share():
    group = Share(f"ledgerline-abuse-{os.getpid()}")
    yield group
    group.close()


def was_felt(what: str, did: dict) -> bool:
    """That there was an abuse, and that the ledger refused what it says it does."""
    if what == "silent":
        return did["opened"] >= 2_600 and did["ended"] > 2_000
    if what == "garbage":
        return did["refused"] >= 3 and did["committed"] == 0
    if what == "values":
        return did["committed"] >= 20
    return did["turns"] > 0


@pytest.mark.skipif(not LONG, reason="runs with ./run-tests --long: four flights")
@pytest.mark.parametrize("what", ["burn", "silent", "garbage", "values"])
def test_four_drones_fly_on_beside(tmp_path, share, what):
    flight = fly(tmp_path, "--drones", str(DRONES), "--seconds", str(SECONDS + 10))
    wait_for_flight(tmp_path, flight)
    done = share.run(BIN / "test_abuse", "--config", as_user(tmp_path / "run", 3, "User1"), what, "--seconds", str(SECONDS))
    did = json.loads(done.stdout)
    assert flight.wait(120) == 0, printed(tmp_path)
    report = result(tmp_path)
    modes = [r for r in records(tmp_path / "run" / "link.trace") if r.kind == TraceKind.MODE and r.extra == HOLD and r.id == FLYING]
    two_way = [drone["two_way_ms"] for drone in report["drones"]]
    print(json.dumps({"what": what, "did": did, "holds": len(modes),
                      "two_way_p50_ms": [round(one["median"], 1) for one in two_way], "p99_ms": [round(one["p99"], 1) for one in two_way]}))
    assert was_felt(what, did), did
    assert not modes, "a drone held"
    assert report["ok"], report
    assert_nothing_left()
