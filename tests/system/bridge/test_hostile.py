"""What others write, on DDS or on the ledger, that is no message: counted, and the next good one goes through."""
import base64
import dataclasses
import json
import os
import subprocess
import time

import cyclonedds.idl as idl
from conftest import BIN, TIMEOUT_S
from cyclone import Reader, Text, Writer
from test_bridge import ANYBODY, topic
from test_hosts import DRONE_HOST, GROUND_HOST, MANUAL, STRING, say_until

HEADER = b"\0\1\0\0"
NO_CDR = [b"", b"\7\7\0\0 a header that is none", b"\0\2\0\0 one of a list of parameters"]
CUT = [HEADER, HEADER + b"\0\0\0\0", HEADER + b"\xff\xff\xff\x7f", HEADER + b"\x01" * 20]  # the rest of a message is missing
LONG = "x" * 1_100_000  # beyond what is taken off DDS


def impostor(name: str):
    """Of DDS's type of that name, and not what it should be: the rest of a message is missing, or it is too long."""
    @dataclasses.dataclass
    class Impostor(idl.IdlStruct, typename=name):
        data: str
    return Impostor


def submit(ledger, organisation: int, user: str, *words: str) -> subprocess.CompletedProcess:
    endpoint, ca = ledger.peer(organisation)
    return subprocess.run([BIN / "client_example", endpoint, ca, f"Org{organisation}MSP", ledger.msp_dir(organisation, user),
                           "submit", *words], capture_output=True, text=True, timeout=TIMEOUT_S, env=os.environ)


def summary(program) -> dict:
    return json.loads(program.status_file.with_suffix(".summary.json").read_text())


def set_asset(ledger, organisation: int, name: str, kind: str, data: bytes) -> None:
    done = submit(ledger, organisation, "User1", "set", json.dumps(
        {"assets": [{"id": name, "msgType": kind, "msgData": base64.b64encode(data).decode()}]}))
    assert done.returncode == 0, done.stderr


def refused_by_contract(ledger, words: str) -> None:
    done = submit(ledger, 3, "User1", "set", words)
    assert done.returncode == 1 and "SetCall" in done.stderr, done.stderr


def test_a_bridge_counts_what_is_no_message(embedded, bridges):
    carried = topic("/text", STRING, ANYBODY) + topic("/foreign", STRING, 'direction = "from_ledger"', ANYBODY)
    here, there = bridges(embedded, bridges.directory, 1, 41, carried), bridges(embedded, bridges.directory, 2, 42, carried)
    writer, reader = Writer(41, "/text", Text).wait_for_readers(), Reader(42, "/text", Text)
    say_until(writer, Text("the way is open"), reader)
    writer.write(Text(LONG))
    here.wait_for("/text", "to_ledger", lambda t: t["dds_refused"] == 1 and t["drops"] == {})
    shown = subprocess.run([BIN / "ledgerline", "topics", "--once", here.status_file], capture_output=True, text=True)
    assert "dds_refused 1" in shown.stdout

    # Signed by a member, and the contract does not look into messages.
    for data in NO_CDR:
        set_asset(embedded, 3, "Org3MSP/foreign", "std_msgs/msg/String", data)
    set_asset(embedded, 3, "Org3MSP/foreign", "no type", HEADER)
    refused_by_contract(embedded, '{"assets":[{"id":"Org3MSP/foreign"')
    set_asset(embedded, 3, "Org3MSP/foreign", "std_msgs/msg/String", HEADER)  # cut, but bytes are all that a bridge knows
    for bridge in (here, there):
        foreign = bridge.wait_for("/foreign", "from_ledger", lambda t: t["messages"] == 1)
        assert foreign["drops"] == {"malformed": len(NO_CDR), "wrong_type": 1}
    writer.write(Text("still here"))
    assert Text("still here") in reader.take_all(1)


def test_agent_and_ground_count_what_is_no_message(embedded, hosts):
    agent, ground = hosts("agent", 1, DRONE_HOST, ""), hosts("ground", 2, GROUND_HOST, "", MANUAL)
    twist, pose = impostor("geometry_msgs::msg::dds_::Twist_"), impostor("geometry_msgs::msg::dds_::PoseStamped_")
    pilot = Writer(GROUND_HOST, "/tello1/cmd_vel", twist).wait_for_readers()
    mocap = Writer(DRONE_HOST, "/vrpn_mocap/tello1/pose", pose).wait_for_readers()
    takeoff = Writer(GROUND_HOST, "/tello1/takeoff", impostor("std_msgs::msg::dds_::Empty_")).wait_for_readers()
    time.sleep(1)  # the readers have yet to find the writers, and hear nothing from before that
    for text in ("", "cut", "cut off"):
        pilot.write(twist(text))
        mocap.write(pose(text))
        time.sleep(0.1)
    takeoff.write(takeoff.writer.topic.data_type(LONG))
    # The drone's own identity, and no state in what it says.
    for name, kind in (("link", "ledgerline_msgs/msg/LinkStatus"), ("odom", "nav_msgs/msg/Odometry"),
                       ("battery", "sensor_msgs/msg/BatteryState"), ("failsafe", "diagnostic_msgs/msg/DiagnosticArray")):
        for data in NO_CDR + CUT:
            set_asset(embedded, 1, f"tello1/{name}", kind, data)
    time.sleep(1)
    assert agent.process.poll() is None and ground.process.poll() is None
    agent.stop()
    ground.stop()
    assert summary(agent)["mocap_lost"] == 3
    reported = summary(ground)
    assert reported["drones"][0]["pilot"]["dds_refused"] == 1 and reported["drones"][0]["pilot"]["malformed"] == 3
    assert reported["states_malformed"] == len(NO_CDR + CUT) and reported["drones"][0]["states_received"] == 0
