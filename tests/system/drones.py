"""Simulated drones in one network namespace, unmodified clients in others."""
import json
import os
import pathlib
import subprocess

import netns
import pytest
from trace_file import records

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])


class Drones:
    """ledgerline-sim with N drones at 10.77.0.2, 10.77.0.3 ..., and client hosts 10.77.1.1 ... that reach them."""

    def __init__(self, directory: pathlib.Path, count: int, clients: int, *options: str) -> None:
        self.hosts = [f"10.77.0.{k + 2}" for k in range(count)]
        self.summary_file = directory / "summary.json"
        self.trace_file = directory / "truth.trace"
        self.sky = netns.Namespace()
        self.clients = [netns.Namespace() for _ in range(clients)]
        for host in self.hosts:
            self.sky.run("ip", "addr", "add", f"{host}/32", "dev", "lo")
        for i, client in enumerate(self.clients):
            netns.connect(self.sky, f"10.77.2.{i + 1}", client, f"10.77.1.{i + 1}", f"client{i}")
        self.process = self.sky.popen(BIN / "ledgerline-sim", "--drones", count, "--address", self.hosts[0],
                                      "--summary", self.summary_file, "--trace", self.trace_file, *options,
                                      stdout=subprocess.PIPE)
        ready = json.loads(self.process.stdout.readline())
        assert ready["ready"] is True

    def fly(self, *functions, timeout_s: float = 90) -> None:
        """Runs each function as a client host of its own, all at once; fails as they fail."""
        forks = [netns.Fork(client, function) for client, function in zip(self.clients, functions, strict=True)]
        for fork in forks:
            fork.join(timeout_s)

    def end(self) -> dict:
        """Ends the simulator and gives its summary."""
        self.process.terminate()
        assert self.process.wait(10) == 0
        return json.loads(self.summary_file.read_text())

    def truth(self, drone: int = 1) -> list:
        """(x, y, z, yaw, in flight) thirty times a second; after end()."""
        return [(*r[6:], r.extra == 1) for r in records(self.trace_file) if r.drone == drone]

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        for namespace in (self.sky, *self.clients):
            namespace.close()


@pytest.fixture
def drones(tmp_path):
    made = []

    def make(count: int, clients: int = 1, *options: str) -> Drones:
        made.append(Drones(tmp_path, count, clients, *options))
        return made[-1]

    yield make
    for each in made:
        each.close()
