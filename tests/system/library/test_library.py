"""The client and the shim as libraries for others: the examples, here and as a project of somebody else."""
import json
import os
import pathlib
import signal
import socket
import subprocess
import time

import pytest
from programs import BIN, ask, user_msp

PUBLIC = ["common/crypto/crypto.hpp", "common/fabric/client/client.hpp", "common/fabric/tx/transaction.hpp", "common/rt/clock.hpp",
          "common/base/result.hpp", "chaincode/shim/shim.hpp"]


@pytest.fixture(scope="module")
def ledger(tmp_path_factory):
    """The embedded node: (endpoint, directory)."""
    directory = tmp_path_factory.mktemp("ledger") / "node"
    process = subprocess.Popen([BIN / "ledgerline-node", "--dir", directory, "--listen", "127.0.0.1:0"],
                               stdout=subprocess.PIPE, text=True)
    yield json.loads(process.stdout.readline())["endpoint"], directory
    process.terminate()
    assert process.wait(timeout=20) == 0


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> pathlib.Path:
    prefix = tmp_path_factory.mktemp("installed")
    subprocess.run(["cmake", "--install", BIN.parent, "--prefix", prefix], check=True, capture_output=True)
    return prefix


@pytest.fixture(scope="module")
def external_builds(installed, tmp_path_factory) -> pathlib.Path:
    """The installed examples, built outside the tree."""
    build = tmp_path_factory.mktemp("external_builds")
    for command in (["cmake", "-G", "Ninja", "-S", installed / "share/ledgerline/examples", "-B", build,
                     f"-DCMAKE_PREFIX_PATH={installed}"], ["cmake", "--build", build]):
        ran = subprocess.run(command, capture_output=True, text=True)
        assert ran.returncode == 0, ran.stdout + ran.stderr
    return build


def converse(ledger, program: pathlib.Path, key: str) -> None:
    """Every verb of the example client."""
    endpoint, directory = ledger

    def say(user: str, *words: str) -> subprocess.CompletedProcess:
        return ask(endpoint, directory, 1, user_msp(directory, 1, user), *words, program=program)

    written = say("User1", "submit", "set", json.dumps({"id": key, "msgType": "std_msgs/msg/String", "msgData": "aGk="}))
    assert written.returncode == 0, written.stderr
    tx_id, block = written.stdout.split()[0], int(written.stdout.split()[3].rstrip(":"))
    assert json.loads(say("User2", "evaluate", "get", key).stdout)["msgData"] == "aGk="
    blocks = say("User1", "blocks", "0", str(block + 1)).stdout.splitlines()
    assert len(blocks) == block + 1 and "config=0" in blocks[0]
    assert blocks[block].startswith(f"block {block}, ") and f" {tx_id}=0" in blocks[block]
    event = say("User1", "events", str(block), "1").stdout
    assert event.startswith(f"event set in block {block}: ") and key in event
    refused = say("User2", "submit", "set", json.dumps({"id": key, "msgType": "t"}))
    assert refused.returncode == 1 and "not to Org1MSP CN=User2@" in refused.stderr
    assert say("User1", "evaluate", "get", "tello1/none").returncode == 1


def test_the_example_client_writes_asks_and_follows(ledger):
    converse(ledger, BIN / "client_example", "tello1/example")


def test_an_external_project_finds_builds_and_runs_the_client(ledger, external_builds):
    converse(ledger, external_builds / "client", "tello1/outsider")


def test_an_external_chaincode_serves_and_ends(external_builds):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen([external_builds / "chaincode"], env={
        **os.environ, "CHAINCODE_ID": "counter:1", "CHAINCODE_SERVER_ADDRESS": f"127.0.0.1:{port}"})
    deadline = time.monotonic() + 20
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            break
        except ConnectionRefusedError:
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=20) == 0


@pytest.mark.parametrize("header", PUBLIC)
def test_a_public_header_stands_alone_and_without_grpc(installed, header):
    ran = subprocess.run(["c++", "-std=c++20", "-Wall", "-Wextra", "-Werror", "-I", installed / "include/ledgerline",
                          "-include", header, "-fsyntax-only", "-MD", "-MF", "/dev/stdout", "-x", "c++", "/dev/null"],
                         capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert header in ran.stdout
    assert not any(word in ran.stdout for word in ("grpc", "protobuf", "absl", "openssl", ".pb.h"))
