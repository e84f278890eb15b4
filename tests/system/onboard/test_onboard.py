"""What goes to a companion computer: what its programs need, what systemd is reported of them, and they themselves, cross-built."""
import contextlib
import ctypes
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import time

import pytest

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
ROOT = pathlib.Path(__file__).parents[3]
AARCH64 = ROOT / "build" / "aarch64" / "bin"
SYSROOT = ROOT / "build" / "sysroot-aarch64"
LONG = os.environ.get("LEDGERLINE_LONG") == "1"
PROGRAMS = ["ledgerline-link", "ledgerline-agent", "ledgerline-roudi"]


def listed(program: str) -> set[str]:
    """The libraries that docs/three-machines.md lists."""
    row = re.search(rf"^\| `{program}` .*$", (ROOT / "docs/three-machines.md").read_text(), re.MULTILINE)
    return set(re.findall(r"`(lib[^`]+)`", row[0]))


def needed(program: pathlib.Path) -> set[str]:
    dynamic = subprocess.run(["readelf", "--dynamic", "--wide", program], capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"\(NEEDED\).*\[(.+)\]", dynamic))


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("built", [BIN, AARCH64], ids=["here", "aarch64"])
def test_a_program_needs_the_libraries_that_the_page_lists(program, built):
    if built == AARCH64 and not (AARCH64 / program).exists():
        pytest.skip("not cross-built: ./run-tests does it")
    assert needed(built / program) - {"ld-linux-aarch64.so.1"} == listed(program)


class Manager:
    """In systemd's place: hears what the programs of a flight say, and who says it."""

    def __init__(self, folder: pathlib.Path):
        self.name = folder / "notify"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(self.name))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)

    def listen(self, seconds: float, enough=lambda heard: False) -> list[tuple[str, str]]:
        heard, until = [], time.monotonic() + seconds
        while not enough(heard) and time.monotonic() < until:
            self.socket.settimeout(max(0.01, until - time.monotonic()))
            with contextlib.suppress(TimeoutError):
                message, ancillary, _, _ = self.socket.recvmsg(256, socket.CMSG_SPACE(12))
                pid = struct.unpack("3i", ancillary[0][2])[0]
                heard.append((os.path.basename(os.readlink(f"/proc/{pid}/exe")), message.decode()))
        return heard


def loop_of_link() -> int:
    """link's real-time thread."""
    here = os.readlink("/proc/self/ns/net")
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if os.readlink(process / "exe") == str(BIN / "ledgerline-link") and os.readlink(process / "ns/net") == here:
                for thread in (int(task.name) for task in (process / "task").iterdir()):
                    if os.sched_getscheduler(thread) == os.SCHED_FIFO:
                        return thread
    pytest.skip("link got no SCHED_FIFO on this machine, by which its loop is known")


@contextlib.contextmanager
def standing_still(thread: int):
    """One thread alone, while those beside it run on."""
    seize, interrupt, detach, wait_all = 0x4206, 0x4207, 17, 0x40000000
    ptrace = ctypes.CDLL(None, use_errno=True).ptrace
    assert ptrace(seize, thread, None, None) == 0 and ptrace(interrupt, thread, None, None) == 0, os.strerror(ctypes.get_errno())
    os.waitpid(thread, wait_all)
    try:
        yield
    finally:
        ptrace(detach, thread, None, None)


def hear_of_a_flight(manager: Manager) -> None:
    watched = [("ledgerline-link", "WATCHDOG=1"), ("ledgerline-agent", "WATCHDOG=1")]
    heard = manager.listen(60, lambda heard: all(heard.count(one) >= 3 for one in watched))
    assert {p for p, message in heard if message == "READY=1"} == set(PROGRAMS)
    assert all(heard.count(one) >= 3 for one in watched), heard
    assert ("ledgerline-roudi", "WATCHDOG=1") not in heard
    for program, _ in watched:
        assert [message for p, message in heard if p == program].index("READY=1") == 0, "ready before it is watched"

    with standing_still(loop_of_link()):
        manager.listen(0.7)  # what the loop did before, of which is reported every half second
        heard = manager.listen(2)
        assert watched[0] not in heard, "link's other thread spoke for a loop that stands still"
        assert watched[1] in heard
    assert watched[0] in manager.listen(10, lambda heard: watched[0] in heard)


def test_systemd_is_notified_by_programs_that_are_ready_and_live_and_by_no_loop_that_stands_still(tmp_path):
    manager = Manager(tmp_path)
    flight = subprocess.Popen([BIN / "ledgerline", "fly", "--out", tmp_path / "run", "--laps", "50"],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              env={**os.environ, "NOTIFY_SOCKET": str(manager.name), "WATCHDOG_USEC": "1000000"})
    try:
        hear_of_a_flight(manager)
    finally:
        flight.send_signal(signal.SIGINT)
        flight.wait(60)


def own_file(program: pathlib.Path, place: str) -> str:
    """Of the function that a call is made from, whatever was inlined into it. `place` is where it returns to."""
    reported = subprocess.run(["addr2line", "-i", "-e", program, hex(int(place, 16) - 1)], capture_output=True, text=True, check=True).stdout
    return os.path.basename(reported.splitlines()[-1].split(":")[0])


def test_the_main_loop_of_agent_takes_no_lock_but_those_that_the_page_lists(tmp_path):
    watch = BIN.parent / "tests/unit/onboard/libloop_watch.so"
    if not watch.exists():
        pytest.skip("the watch is not built with sanitizers")
    report = tmp_path / "watch"
    flown = subprocess.run([BIN / "ledgerline", "fly", "--out", tmp_path / "run", "--seconds", "4"], stdout=subprocess.DEVNULL, timeout=120,
                           env={**os.environ, "LD_PRELOAD": str(watch), "LOOP_WATCH_LOCKS": "ledgerline-agent",
                                "LOOP_WATCH_REPORT": str(report)})
    assert flown.returncode == 0
    turns, *offences = report.read_text().splitlines()
    summary = json.loads((tmp_path / "run/agent.summary.json").read_text())
    assert int(turns.removeprefix("turns ")) > summary["link_wakes"] > 100
    assert summary["states_without_wake"] < 0.2 * summary["link_wakes"], "states are found by chance, and not by a wake"
    seen = set()
    for offence in offences:
        call, file, place = re.fullmatch(r"(\w+): \d+ x, by (.+)\+(0x[0-9a-f]+)", offence).groups()
        if call.endswith(("unlock", "signal", "broadcast", "post")):
            continue  # gives, and takes nothing
        ours = os.path.basename(file) == "ledgerline-agent"
        seen.add(own_file(BIN / "ledgerline-agent", place) if ours else os.path.basename(file).split(".so")[0])
    agents = (ROOT / "docs/architecture.md").read_text().split("**Locks on the main loop.**")[1].split("\n## ")[0]
    listed_locks = set(re.findall(r"^\| `([\w.]+)`", agents, re.MULTILINE))
    assert seen <= listed_locks
    assert {"pipeline.cpp", "msp.cpp", "libiceoryx_hoofs"} <= seen, "the watch sees nothing"


# qemu-user knows no multicast.
UNICAST = """<CycloneDDS><Domain id="any"><General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General><Discovery>
<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""


def test_the_cross_built_programs_fly_a_lap_under_qemu(tmp_path):
    if not LONG:
        pytest.skip("with ./run-tests --long")
    programs = tmp_path / "bin"
    programs.mkdir()
    for native in BIN.glob("ledgerline-*"):
        (programs / native.name).symlink_to(native)
    for program in PROGRAMS:
        script = programs / program
        script.unlink()
        script.write_text(f'#!/bin/sh\nexec qemu-aarch64-static -L {SYSROOT} {AARCH64 / program} "$@"\n')
        script.chmod(0o755)
    result, unicast = tmp_path / "result.json", tmp_path / "unicast.xml"
    unicast.write_text(UNICAST)
    flight = subprocess.run([BIN / "ledgerline", "fly", "--out", tmp_path / "run", "--json", result, "--laps", "1", "--dds", unicast],
                            env={**os.environ, "LEDGERLINE_BIN": str(programs)},
                            capture_output=True, text=True, timeout=300)
    assert flight.returncode == 0, flight.stdout + flight.stderr
    report = json.loads(result.read_text())
    print(flight.stdout)
    drone = report["drones"][0]
    assert report["ok"] is True and len(drone["lap_s"]) == 1
    assert drone["commands"]["applied"] > 0.5 * drone["commands"]["sent"] > 100
