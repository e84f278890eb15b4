"""Programs that say {"ready":true} in a line of their standard output and later a line of status each, and what processes use."""
import contextlib
import json
import os
import pathlib
import subprocess
import time
from collections.abc import Callable

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Failed(Exception):
    """Which program, and its last words."""


class Program:
    """Its log is NAME.log; what it says on standard output is in NAME.out, a file, which never makes it wait for a reader."""

    def __init__(self, start: Callable[..., subprocess.Popen], command: list, log: pathlib.Path, log_mode: str = "wb"):
        self.log, self.said = log, log.with_suffix(".out")
        with open(self.said, "wb") as out, open(log, log_mode) as errors:
            self.process = start(*command, stdout=out, stderr=errors)

    def fail(self, what: str):
        raise Failed(f"{self.log.stem} {what}: " + "\n".join(self.log.read_text(errors="replace").splitlines()[-5:]))

    def lines(self) -> list[dict]:
        """What it has said so far; a line that is not whole yet, or no object, is left out."""
        found = []
        for line in self.said.read_text(errors="replace").splitlines():
            with contextlib.suppress(ValueError):
                if isinstance(said := json.loads(line), dict):
                    found.append(said)
        return found

    def wait_ready(self, limit_s: float) -> dict:
        """The line that says so."""
        until = time.monotonic() + limit_s
        while time.monotonic() < until:
            ended = self.process.poll() is not None
            for said in self.lines():
                if said.get("ready") is True:
                    return said
            if ended:
                self.fail("ended before it was ready")
            time.sleep(0.02)
        self.fail(f"was not ready within {limit_s} s")

    def end(self, limit_s: float) -> int | None:
        """Its exit code; none: it had to be killed."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=limit_s)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                return None
        return self.process.returncode


def cpu_s(pid: int) -> float:
    """User and system time of a process, proc(5)."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S
