"""Network namespaces, so that unmodified Tello clients (which bind 0.0.0.0:8889) and simulated drones run on one machine.

Needs to be root, if only of a user namespace: scripts/isolated makes one.
"""
import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
import traceback

PR_SET_PDEATHSIG = 1
CLONE_NEWNET = 0x40000000
libc = ctypes.CDLL(None, use_errno=True)


def die_with_parent() -> None:
    """For preexec_fn: no process outlives the test run."""
    libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class Namespace:
    """A network namespace, with lo up, that lasts until close()."""

    def __init__(self) -> None:
        self.holder = subprocess.Popen(["unshare", "-n", "sleep", "infinity"], preexec_fn=die_with_parent)
        mine = os.readlink("/proc/self/ns/net")
        deadline = time.monotonic() + 10
        while os.readlink(self._file()) == mine:
            if self.holder.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("no network namespace (not root?): run through scripts/isolated")
            time.sleep(0.005)
        self.run("ip", "link", "set", "lo", "up", "multicast", "on")

    def _file(self) -> str:
        return f"/proc/{self.holder.pid}/ns/net"

    def command(self, *command) -> list:
        return ["nsenter", f"--net={self._file()}", *map(str, command)]

    def run(self, *command) -> None:
        subprocess.run(self.command(*command), check=True)

    def popen(self, *command, **options) -> subprocess.Popen:
        return subprocess.Popen(self.command(*command), preexec_fn=die_with_parent, **options)

    def join(self) -> None:
        """Moves the calling process into this namespace: for a fork."""
        with open(self._file()) as file:
            if libc.setns(file.fileno(), CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "setns")

    def close(self) -> None:
        self.holder.kill()
        self.holder.wait()


def connect(left: Namespace, left_address: str, right: Namespace, right_address: str, name: str) -> None:
    """A cable of one host each end: `left_address` and all that `left` has on its lo are reached from `right`."""
    left.run("ip", "link", "add", name, "type", "veth", "peer", "name", "eth0", "netns", right.holder.pid)
    for here, address, device, there in ((left, left_address, name, right_address), (right, right_address, "eth0", left_address)):
        here.run("ip", "addr", "add", f"{address}/32", "dev", device)
        here.run("ip", "link", "set", device, "up")
        here.run("ip", "route", "add", f"{there}/32", "dev", device)
    right.run("ip", "route", "add", "default", "via", left_address, "dev", "eth0", "onlink")


class Fork:
    """Runs a function in a process of its own (clients have global sockets and threads), inside a namespace."""

    def __init__(self, namespace: Namespace, function, *arguments) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        self.function = function
        self.pid = os.fork()
        if self.pid == 0:
            status = 1
            with contextlib.suppress(BaseException):
                die_with_parent()
                try:
                    namespace.join()
                    function(*arguments)
                    status = 0
                except BaseException:
                    traceback.print_exc()
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(status)

    def join(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while True:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() > deadline:
                os.kill(self.pid, signal.SIGKILL)
                os.waitpid(self.pid, 0)
                raise AssertionError(f"{self.function.__name__}: not done after {timeout_s} s (its output is above)")
            time.sleep(0.02)
        assert status == 0, f"{self.function.__name__} failed: its traceback is above"
