"""Agent and ground bridge topics beside their own work; every program keeps outsiders off its secured domain."""
import pathlib
import subprocess
import time

import pytest
from conftest import BIN, TIMEOUT_S
from cyclone import Empty, Number, Pose, Reader, Text, Writer
from netns import die_with_parent
from test_bridge import LONG, topic

DRONE_HOST, GROUND_HOST = 31, 32  # DDS domains
MANUAL = '[flight]\nshape = "manual"\n'
STRING = 'type = "std_msgs/msg/String"'


def say_until(writer: Writer, message, reader: Reader) -> list:
    """What came first, however long the way there takes to open."""
    writer.wait_for_readers()
    deadline = time.monotonic() + TIMEOUT_S
    while not (taken := reader.take()):
        assert time.monotonic() < deadline, "nothing comes"
        writer.write(message)
        time.sleep(0.05)
    return taken


def test_topics_of_a_drone_go_from_its_host_to_the_ground_host_and_orders_back(hosts):
    agent = hosts("agent", 1, DRONE_HOST, topic("/tello1/*", 'direction = "to_ledger"') +
                  topic("/order", STRING, 'direction = "from_ledger"', 'from = "Org2MSP"'))
    ground = hosts("ground", 2, GROUND_HOST, topic("/tello1/*", 'direction = "from_ledger"', 'from = "tello1"') +
                   topic("/order", STRING, 'direction = "to_ledger"'), MANUAL)
    odom = Writer(DRONE_HOST, "/tello1/odom", Text)  # somebody who would speak for the agent
    assert say_until(Writer(DRONE_HOST, "/tello1/note", Text), Text("a note"), Reader(GROUND_HOST, "/tello1/note", Text))[0] == \
        Text("a note")
    assert say_until(Writer(GROUND_HOST, "/order", Text), Text("an order"), Reader(DRONE_HOST, "/order", Text))[0] == \
        Text("an order")

    count = 1_000
    writer, reader = Writer(DRONE_HOST, "/tello1/count", Number), Reader(GROUND_HOST, "/tello1/count", Number)
    say_until(writer, Number(0), reader)
    for number in range(1, count + 1):
        writer.write(Number(number))
        time.sleep(0.001)
    came = [message.data for message in reader.take_all(count)]
    assert [number for number in came if number > 0] == list(range(1, count + 1))

    up = agent.wait_for("/tello1/count", "to_ledger", lambda t: t["pending"] == 0)
    down = ground.wait_for("/tello1/count", "from_ledger", lambda t: t["messages"] == up["messages"])
    assert up["id"] == down["id"] == "tello1/count", "below its drone's name without a word of [[enrolled]]"
    assert up["drops"] == down["drops"] == {}
    assert odom.writer.get_matched_subscriptions() == [] and agent.topic("/tello1/odom", "to_ledger") is None


@pytest.mark.skipif(not LONG, reason="with ./run-tests --long")  # half a minute of time-outs
def test_a_bridge_that_cannot_begin_is_tried_again_and_the_agent_goes_on(hosts):
    agent = hosts("agent", 1, DRONE_HOST, topic("/note", STRING, 'channel = "nowhere"', 'direction = "to_ledger"'))
    deadline = time.monotonic() + TIMEOUT_S
    words = "the bridge starts again: gave up after 15 s waiting until the blocks of channel nowhere can be read"
    while agent.log().count(words) < 2:
        assert agent.process.poll() is None and time.monotonic() < deadline, agent.log()
        time.sleep(0.1)


def secured(ledger, organisation: int, user: str, directory: pathlib.Path) -> str:
    """[dds] of a member, by the documents of its organisation's authority."""
    folder, msp = directory / f"org{organisation}", ledger.msp_dir(organisation, user)
    return "".join(f'{key} = "{file}"\n' for key, file in (
        ("identity_ca", folder / "identity_ca.pem"), ("governance", folder / "governance.p7s"),
        ("permissions", folder / "permissions.p7s"), ("certificate", next((msp / "signcerts").iterdir())),
        ("private_key", next((msp / "keystore").iterdir()))))


def make_documents(ledger, organisation: int, directory: pathlib.Path, writes_poses: str) -> None:
    ca = ledger.organisation(organisation) / "ca"
    members = {user: next((ledger.msp_dir(organisation, user) / "signcerts").iterdir()) for user in ("User1", "Admin")}
    subprocess.run([BIN / "ledgerline", "dds-security", "--ca", ca / f"ca.org{organisation}.ledgerline-cert.pem", "--ca-key",
                    ca / "priv_sk", "--out", directory / f"org{organisation}", *members.values(), "--mocap", members[writes_poses]],
                   check=True, stdout=subprocess.DEVNULL)


def test_an_outsider_neither_reads_nor_writes_on_a_secured_domain(embedded, bridges, hosts, running, tmp_path):
    """sim and agent are of Org1's domain, ground and a bridge of Org2's; the outsider is in both."""
    make_documents(embedded, 1, tmp_path, "Admin")
    make_documents(embedded, 2, tmp_path, "User1")  # ground brings them from the ledger
    (tmp_path / "sim.toml").write_text(f"[dds]\ndomain = {DRONE_HOST}\n{secured(embedded, 1, 'Admin', tmp_path)}")
    sim = subprocess.Popen([BIN / "ledgerline-sim", "--config", tmp_path / "sim.toml", "--mocap-hz", "20"],
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=die_with_parent)
    pose, note = "/vrpn_mocap/tello1/pose", "/tello1/note"
    outside = [Reader(domain, pose, Pose) for domain in (DRONE_HOST, GROUND_HOST)]
    lies = [Writer(DRONE_HOST, note, Text), Writer(GROUND_HOST, "/tello1/takeoff", Empty)]
    agent = hosts("agent", 1, DRONE_HOST, topic(pose, 'type = "geometry_msgs/msg/PoseStamped"', 'direction = "to_ledger"') +
                  topic(note, STRING, 'direction = "to_ledger"'), dds=secured(embedded, 1, "User1", tmp_path))
    ground = hosts("ground", 2, GROUND_HOST, topic(pose, 'direction = "from_ledger"', 'from = "Org1MSP"'), MANUAL,
                   dds=secured(embedded, 2, "User1", tmp_path))
    insider = bridges(embedded, tmp_path, 2, GROUND_HOST, topic(pose, 'direction = "to_ledger"'), name="insider", user="Admin",
                      dds=secured(embedded, 2, "Admin", tmp_path))
    agent.wait_for(pose, "to_ledger", lambda t: t["messages"] > 20)
    ground.wait_for(pose, "from_ledger", lambda t: t["messages"] > 20)
    insider.wait_for(pose, "to_ledger", lambda t: t["taken"] > 20)
    lies[0].write(Text("I am one of you"))
    lies[1].write(Empty())
    time.sleep(1)  # what must not come gets its time to come
    assert [reader.take() for reader in outside] == [[], []]
    assert [reader.reader.get_matched_publications() for reader in outside] == [[], []]
    assert [writer.writer.get_matched_subscriptions() for writer in lies] == [[], []]
    assert agent.topic(note, "to_ledger")["taken"] == 0
    sim.terminate()
    assert sim.wait(timeout=TIMEOUT_S) == 0
