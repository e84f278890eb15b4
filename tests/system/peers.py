"""Peers on DDS: programs that know nothing of this project, on a domain each."""
import collections
import functools
import json
import os
import pathlib
import select
import signal
import subprocess
import sys
import time

import netns

BRIDGE = pathlib.Path(__file__).with_name("bridge")
RUST = pathlib.Path(os.environ.get("LEDGERLINE_PEER", BRIDGE.parents[2] / "build" / "peer")) / "release/ros2-client-peer"
FAST_DDS = pathlib.Path(os.environ["LEDGERLINE_BIN"]) / "fast_dds_peer"
PYTHON = [sys.executable, BRIDGE / "cyclonedds_peer.py"]
COMMANDS = {"cyclonedds": PYTHON, "ros2-client": [RUST]}
LAN = """<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lan0"/></Interfaces></General></Domain>
</CycloneDDS>"""


@functools.cache
def make_lan() -> None:
    """A network card in this namespace, once: ros2-client does not talk over loopback."""
    for command in ("link add lan0 type veth peer name lan1", "addr add 10.88.0.1/24 dev lan0", "link set lan0 up",
                    "link set lan1 up", "route add 224.0.0.0/4 dev lan0"):
        subprocess.run(["ip", *command.split()], check=True)


def why_missing(kind: str) -> str:
    """Empty where a peer can run; else why not."""
    if kind == "ros2-client" and not RUST.exists():
        return f"{RUST} is missing: cargo is missing or too old (run-tests says which it needs)"
    if kind == "fast-dds" and not FAST_DDS.exists():
        return f"{FAST_DDS} is missing: it is built where Fast DDS is (libfastrtps-dev)"
    return ""


class Peer:
    """A running program whose standard output is lines of JSON."""

    def __init__(self, command: list, domain: int) -> None:
        self.process = subprocess.Popen([str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        env={**os.environ, "ROS_DOMAIN_ID": str(domain), "CYCLONEDDS_URI": LAN},
                                        preexec_fn=netns.die_with_parent)
        self.lines = collections.deque()
        self.rest = b""

    def line(self, timeout_s: float = 60) -> dict:
        """The next line; fails where none comes, which is no measure of speed."""
        while not self.lines:
            assert select.select([self.process.stdout], [], [], timeout_s)[0], f"{self.process.args} says nothing more"
            came = os.read(self.process.stdout.fileno(), 1 << 16)
            assert came, f"{self.process.args} has ended"
            *whole, self.rest = (self.rest + came).split(b"\n")
            self.lines.extend(whole)
        return json.loads(self.lines.popleft())

    def lines_until(self, key: str, within_s: float = 300) -> list:
        """Up to and with the first that has the key; fails where it has not come after `within_s`."""
        deadline = time.monotonic() + within_s
        lines = [self.line()]
        while key not in lines[-1]:
            assert time.monotonic() < deadline, f"{self.process.args}: no {key} within {within_s} s; last {lines[-3:]}"
            lines.append(self.line())
        return lines

    def go(self) -> None:
        self.process.stdin.write(b"\n")
        self.process.stdin.flush()

    def end_input(self) -> None:
        self.process.stdin.close()

    def end(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


def publisher(kind: str, domain: int, topic: str, first: int, count: int, period_ms: int) -> Peer:
    """Says the message for 0 again and again, then, from go() on, those from `first`, then {"published":count}."""
    return Peer([*COMMANDS[kind], "publish", topic, first, count, period_ms], domain)


def subscriber(kind: str, domain: int, topic: str, count: int) -> Peer:
    """{"ready":true}, then {"number":n,"cdr":hex} for each message; ends after `count` without those for 0."""
    return Peer([*COMMANDS[kind], "subscribe", topic, count], domain)


def nodes(kind: str, domain: int, wanted: str) -> Peer:
    """{"ready":true}, then {"node":name} for each that it sees; ends with the wanted one."""
    return Peer([*COMMANDS[kind], "nodes", wanted], domain)


def pilot(domain: int, drone: str, forward_mps: float, seconds: float) -> Peer:
    """Flies a drone by its topics alone; what it says is in main.rs. Within 20 s it says whether it found its readers; who
    says nothing at all stands in RustDDS's create_datawriter (it waits for room among ten new writers with a lock in hand that
    its event loop needs first) and is restarted."""
    for _ in range(3):
        peer = Peer([RUST, "fly", drone, forward_mps, seconds], domain)
        if select.select([peer.process.stdout], [], [], 40)[0]:
            return peer
        print("the pilot's DDS hangs: restarted")
        peer.end()
    raise AssertionError("the pilot's DDS stood three times")
