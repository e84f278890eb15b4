"""ledgerline-sim as a program: addresses, usage, signals."""
import json
import signal
import socket
import subprocess

import pytest

import netns
from conftest import BIN


@pytest.fixture
def loopback():
    namespace = netns.Namespace()
    yield namespace
    namespace.close()


def start(namespace, *options):
    process = namespace.popen(BIN / "ledgerline-sim", *options, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert json.loads(process.stdout.readline())["ready"] is True
    return process


def end(process, how=signal.SIGTERM) -> int:
    process.send_signal(how)
    process.communicate(timeout=10)
    return process.returncode


def test_drones_count_up_from_127_0_0_2_and_share_the_host_with_a_client_that_allows_it(loopback):
    process = start(loopback, "--drones", "3")

    def client():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states:
            s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            s.bind(("0.0.0.0", 8889))
            states.bind(("0.0.0.0", 8890))
            s.settimeout(5)
            states.settimeout(5)
            for host in ("127.0.0.2", "127.0.0.3", "127.0.0.4"):
                s.sendto(b"command", (host, 8889))
                assert s.recvfrom(1024) == (b"ok", (host, 8889))
            senders = {states.recvfrom(1024)[1] for _ in range(9)}
            assert senders == {("127.0.0.2", 8889), ("127.0.0.3", 8889), ("127.0.0.4", 8889)}

    netns.Fork(loopback, client).join(20)
    assert end(process) == 0


def test_a_second_simulator_on_the_same_addresses_is_refused_with_the_reason(loopback):
    process = start(loopback, "--mocap-hz", "0")
    second = subprocess.run(loopback.command(BIN / "ledgerline-sim", "--mocap-hz", "0"), capture_output=True, text=True, timeout=20)
    assert second.returncode == 1
    assert "another ledgerline-sim holds 127.0.0.2" in second.stderr
    assert end(process, signal.SIGINT) == 0
    again = start(loopback, "--mocap-hz", "0")
    assert end(again) == 0


def test_usage():
    def run(*options):
        return subprocess.run([BIN / "ledgerline-sim", *options], capture_output=True, text=True, timeout=60)

    helped = run("--help")
    assert helped.returncode == 0 and "Examples" in helped.stdout and "--mocap-hz" in helped.stdout
    assert len(helped.stdout.splitlines()) < 45
    assert run("--drones", "0").returncode == 2
    assert run("--drones", "17").returncode == 2
    assert run("--no-such-option").returncode == 2
    pad = run("--pads", "9:0:0")
    assert pad.returncode == 2 and "is no mission pad" in pad.stderr
    wrong = run("--address", "here")
    assert wrong.returncode == 1 and "no IPv4 address" in wrong.stderr


def test_a_simulated_run_is_faster_than_real_time_and_the_same_each_time(tmp_path):
    traces = []
    for name in ("a", "b"):
        done = subprocess.run([BIN / "ledgerline-sim", "--drones", "4", "--simulated-time", "20", "--trace", tmp_path / name],
                              capture_output=True, text=True, timeout=60)
        assert done.returncode == 0
        assert json.loads(done.stdout)["ratio"] > 1
        traces.append((tmp_path / name).read_bytes())
    assert traces[0] == traces[1] and len(traces[0]) > 4 * 20 * 29 * 64
