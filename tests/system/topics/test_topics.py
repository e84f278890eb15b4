"""A ROS 2 machine's view: a drone flown by topics alone, through the ledger, by participants that know nothing of this project."""
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

import peers
import pytest
from cyclonedds.core import Policy
from fabric import needs_fabric
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, printed, result
from netns import die_with_parent
from ros import (BatteryState, DiagnosticArray, Empty, Imu, Odometry, PoseStamped, Outsider, TFMessage, Twist, Vector3)
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"

DRONES, GROUND = 31, 32  # DDS domains
MAX_S = "900"  # of a flight whose test is gone


class Drone:
    """One drone's topics, as its pilot sees them."""

    def __init__(self, outsider: Outsider, name: str):
        self.name = name
        self.odom = outsider.reads(f"/{name}/odom", Odometry)
        self.pose = outsider.reads(f"/{name}/pose", PoseStamped)
        self.battery = outsider.reads(f"/{name}/battery", BatteryState)
        self.imu = outsider.reads(f"/{name}/imu", Imu)
        self.cmd_vel = outsider.writes(f"/{name}/cmd_vel", Twist)
        self.words = {word: outsider.writes(f"/{name}/{word}", Empty) for word in ("takeoff", "land", "stop", "emergency")}

    def say(self, word: str) -> None:
        self.words[word].wait_for_reader().say(Empty())

    def height(self) -> float:
        return self.odom.newest().pose.pose.position.z

    def place(self) -> tuple[float, float]:
        position = self.odom.newest().pose.pose.position
        return position.x, position.y

    def yaw(self) -> float:
        return yaw_of(self.odom.newest())

    def fly(self, seconds: float, forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0) -> float:
        """As a joystick does, 20 times a second. When the first one was said."""
        self.cmd_vel.wait_for_reader()
        begin = time.monotonic()
        while time.monotonic() < begin + seconds:
            self.cmd_vel.say(Twist(Vector3(forward, left, up), Vector3(0.0, 0.0, turn)))
            time.sleep(0.05)
        return begin


def yaw_of(odometry: Odometry) -> float:
    q = odometry.pose.pose.orientation
    return 2 * math.atan2(q.z, q.w)


class Neighbour:
    """Somebody else on the drones' domain: between it and ground's there is only the ledger."""

    def __init__(self, **where):
        self.outsider = outsider = Outsider(DRONES, **where)
        self.mocap = outsider.reads("/vrpn_mocap/tello1/pose", PoseStamped)
        self.ground_says = [outsider.reads("/tello1/odom", Odometry), outsider.reads("/tello1/pose", PoseStamped),
                            outsider.reads("/tf", TFMessage), outsider.reads("/tello1/battery", BatteryState)]
        self.ground_hears = [outsider.writes("/tello1/cmd_vel", Twist), outsider.writes("/tello1/takeoff", Empty)]

    def assert_ground_is_not_here(self) -> None:
        assert len(self.mocap.take()) > 0, "sim is here"
        assert [reader.take() for reader in self.ground_says] == [[]] * len(self.ground_says)
        assert [writer.writer.get_matched_subscriptions() for writer in self.ground_hears] == [[]] * len(self.ground_hears)


def wait_for_states(drone: Drone, out, flight) -> None:
    def look(all):
        assert flight.poll() is None, printed(out)
        return all
    drone.odom.wait(look, timeout_s=180)


def take_off(drone: Drone) -> None:
    drone.say("takeoff")
    drone.odom.wait(lambda all: all and all[-1].pose.pose.position.z > 0.5)
    drone.odom.wait(lambda all: abs(all[-1].twist.twist.linear.z) < 0.05 and all[-1].pose.pose.position.z > 0.5)


def wait_down(drone: Drone) -> None:
    drone.odom.wait(lambda all: all[-1].pose.pose.position.z < 0.15)


def applied(out, drone: int) -> list[tuple[float, list[float]]]:
    """When link flew a plan's first setpoint, and what it reported the drone then."""
    return [(r[0] / 1e9, list(r[6:10])) for r in records(out / "run" / "link.trace") if r[1] == TraceKind.COMMAND_APPLIED and r[2] == drone]


def assert_hover_was_commanded(out, since: float, until: float) -> None:
    """`since` the pilot's last word."""
    held = [v for t, v in applied(out, 1) if since + 1 < t < until]
    assert len(held) > 20, "the hover is commanded"
    assert all(math.hypot(v[0], v[1]) < 0.31 and abs(v[2]) < 0.31 and v[3] == 0 for v in held), \
        "what keeps its place, within a second of the pilot's last word"


def assert_topics_agree(outsider_tf, diagnostics, drone: Drone) -> None:
    odometry = drone.odom.newest()
    name = drone.name
    assert odometry.header.frame_id == "map" and odometry.child_frame_id == f"{name}/base_link"
    same = drone.pose.wait(lambda all: [p for p in all if p.header == odometry.header])
    assert same[0].pose == odometry.pose.pose
    transforms = outsider_tf.wait(lambda all: [t for m in all for t in m.transforms
                                               if t.header == odometry.header and t.child_frame_id == f"{name}/base_link"])
    assert transforms[0].transform.translation == odometry.pose.pose.position
    assert transforms[0].transform.rotation == odometry.pose.pose.orientation
    battery = drone.battery.newest()
    assert battery.header.frame_id == f"{name}/base_link" and 0 < battery.percentage <= 1 and math.isnan(battery.voltage)
    imu = drone.imu.newest()
    assert imu.header.frame_id == f"{name}/base_link"
    force = imu.linear_acceleration
    assert 5 < math.hypot(force.x, force.y, force.z) < 15 and force.z > 5, imu
    q = imu.orientation
    assert math.isclose(q.x**2 + q.y**2 + q.z**2 + q.w**2, 1, abs_tol=1e-6) and imu.angular_velocity_covariance[0] == -1
    # The simulator's drones are switched on at yaw 0, so here their own yaw is the map's; whole degrees.
    assert abs(math.remainder(2 * math.atan2(q.z, q.w) - drone.yaw(), 2 * math.pi)) < 0.3
    stamp = odometry.header.stamp.sec + odometry.header.stamp.nanosec / 1e9
    assert abs(stamp - time.time()) < 30, "ROS headers are real time"
    statuses = diagnostics.wait(lambda all: [s for m in all for s in m.status if s.name == f"{name}/failsafe"])
    assert {"phase", "mode", "cause", "boot_id"} <= {value.key for value in statuses[0].values}


@pytest.mark.parametrize("ledger,drones", [("embedded", 2), ("fabric", 1)] if LONG else [("fabric", 1)])
def test_an_external_program_flies_drones_by_ros_topics_alone(tmp_path, ledger, drones):
    if ledger == "fabric":
        needs_fabric()
    outsider, neighbour = Outsider(GROUND), Neighbour()
    flown = [Drone(outsider, f"tello{k + 1}") for k in range(drones)]
    tf = outsider.reads("/tf", TFMessage)
    flight = fly(tmp_path, "--shape", "manual", "--seconds", MAX_S, "--drones", str(drones), "--ledger", ledger,
                 "--domains", f"{DRONES},{GROUND}")
    first = flown[0]
    wait_for_states(first, tmp_path, flight)
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o700
    for drone in flown:
        take_off(drone)
    # Who comes late reads the newest transitions, too.
    diagnostics = outsider.reads("/diagnostics", DiagnosticArray, Policy.Durability.TransientLocal)
    for drone in flown:
        assert_topics_agree(tf, diagnostics, drone)

    # A turn to the left, then forward: to where the nose is.
    before = first.yaw()
    first_word = first.fly(2, turn=0.6)
    time.sleep(1)
    turned = math.remainder(first.yaw() - before, 2 * math.pi)
    assert 0.6 < turned < 1.6, turned
    x, y = first.place()
    first.fly(2, forward=0.4)
    time.sleep(1.5)
    nose = first.yaw()
    dx, dy = (now - then for now, then in zip(first.place(), (x, y)))
    ahead, aside = dx * math.cos(nose) + dy * math.sin(nose), -dx * math.sin(nose) + dy * math.cos(nose)
    assert ahead > 0.3 and abs(aside) < 0.5 * ahead, (ahead, aside)

    # Faster than allowed, numbers that are none, and then silence.
    first.cmd_vel.say(Twist(Vector3(math.nan, 0.0, 0.0), Vector3()))
    first.cmd_vel.say(Twist(Vector3(1e9, 0.0, 0.0), Vector3()))
    first.fly(1.5, left=5.0)
    silent_since = time.monotonic()
    time.sleep(3)
    stood = first.place()
    time.sleep(1)
    assert math.dist(stood, first.place()) < 0.3, "a pilot who is silent leaves a drone that stands"
    landed_from = time.monotonic()
    neighbour.assert_ground_is_not_here()

    for drone in flown[1:]:
        here = drone.place()
        drone.fly(1.5, forward=-0.4)
        assert math.dist(here, drone.place()) > 0.2
    for drone in flown:
        drone.say("land")
    for drone in flown:
        wait_down(drone)
    time.sleep(2)
    assert flight.poll() is None, "it may take off again"
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)

    report = result(tmp_path)
    assert report["ok"] is True and report["asked"]["shape"] == "manual"
    reported = applied(tmp_path, 1)
    assert_hover_was_commanded(tmp_path, silent_since, landed_from)
    assert max(math.hypot(v[0], v[1]) for _, v in reported) < 0.51, "as fast as paths are flown, not faster"
    answered = min(t for t, v in reported if t > first_word and v[3] > 0)
    last = max(t for t, v in reported if t < landed_from and any(v))
    print(f"{ledger}: two-way of the pilot's drones, ms: {[d['two_way_ms'] for d in report['drones']]}")
    print(f"{ledger}: from the first cmd_vel until link reported the drone {1e3 * (answered - first_word):.0f} ms; "
          f"from the last one until the last setpoint that was not zero {1e3 * (last - silent_since):.0f} ms")
    pilot = pilot_counts(tmp_path, 0)
    assert pilot["bad_values"] == 2 and pilot["malformed"] == 0 and pilot["refused"] == 0, pilot
    assert pilot["velocities"] > 60, pilot
    assert_nothing_left()


@pytest.mark.parametrize("ledger", ["embedded", "fabric"] if LONG else ["embedded"])
def test_a_pilot_of_another_make_flies_a_drone_by_ros_topics_alone(tmp_path, ledger):
    """By ros2-client: takes off, flies straight ahead, is silent, lands."""
    if ledger == "fabric":
        needs_fabric()
    if missing := peers.why_missing("ros2-client"):
        pytest.skip(missing)
    peers.make_lan()
    lan = tmp_path / "lan.xml"
    lan.write_text(peers.LAN)
    forward_mps, seconds = 0.4, 3
    neighbour = Neighbour(cyclone_config=peers.LAN)
    flight = fly(tmp_path, "--shape", "manual", "--seconds", MAX_S, "--ledger", ledger, "--domains", f"{DRONES},{GROUND}",
                 "--dds", lan)
    pilot = peers.pilot(GROUND, "tello1", forward_mps, seconds)
    try:
        said = pilot.lines_until("landed")
    except AssertionError as why:
        raise AssertionError(f"{why}\n{printed(tmp_path)}") from why
    neighbour.assert_ground_is_not_here()
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)

    since_boot = time.time() - time.monotonic()
    begun = {line["begin"]: line["at_s"] - since_boot for line in said if "begin" in line}
    truth = [(r[0] / 1e9, r[6:10]) for r in records(tmp_path / "run" / "sim.trace") if r[1] == TraceKind.TRUTH and r[2] == 1]

    def truth_at(t: float) -> tuple:
        return min(truth, key=lambda row: abs(row[0] - t))[1]
    x, y, _, nose = truth_at(begun["cmd_vel"])
    there = truth_at(begun["land"])
    dx, dy = there[0] - x, there[1] - y
    ahead, aside = dx * math.cos(nose) + dy * math.sin(nose), -dx * math.sin(nose) + dy * math.cos(nose)
    print(f"ros2-client: {ahead:.2f} m ahead, {aside:.2f} m aside, of {forward_mps} m/s for {seconds} s; "
          f"pressed again: {[line['unanswered'] for line in said if 'unanswered' in line]}")
    assert 0.7 < ahead / (forward_mps * seconds) < 1.3 and abs(aside) < 0.3, (ahead, aside)
    assert_hover_was_commanded(tmp_path, begun["silence"], begun["land"])
    assert math.dist(truth_at(begun["land"] - 1)[:2], there[:2]) < 0.3, "a pilot who is silent leaves a drone that stands"
    assert truth[-1][1][2] < 0.15, "landed"

    heard = [line for line in said if "position" in line]
    while_flying = [o for o in heard if begun["cmd_vel"] < o["stamp_s"] - since_boot < begun["land"]]
    assert len(while_flying) > 50
    assert [o["stamp_s"] for o in heard] == sorted(o["stamp_s"] for o in heard)
    for o in while_flying:
        assert (o["frame"], o["child"]) == ("map", "tello1/base_link")
        assert math.dist(o["position"], truth_at(o["stamp_s"] - since_boot)[:3]) < 0.2
    counts = pilot_counts(tmp_path, 0)
    assert counts["velocities"] > 0.8 * 10 * seconds, counts
    assert counts["bad_values"] == counts["malformed"] == counts["refused"] == 0, counts
    assert_nothing_left()


def pilot_counts(out, drone: int) -> dict:
    return json.loads((out / "run" / "ground.summary.json").read_text())["drones"][drone]["pilot"]


READS_ALL = """
import ros
outsider = ros.Outsider()
odom = outsider.reads("/tello1/odom", ros.Odometry)
others = [outsider.reads("/tello1/pose", ros.PoseStamped), outsider.reads("/tf", ros.TFMessage), outsider.reads("/tello1/imu", ros.Imu)]
odom.wait(lambda all: all)
print("reads", flush=True)
odom.wait(lambda all: False, timeout_s=600)
"""


def test_a_stop_is_the_ledgers_and_keeps_the_drone_down(tmp_path):
    outsider = Outsider()
    drone = Drone(outsider, "tello1")
    flight = fly(tmp_path, "--shape", "manual", "--seconds", MAX_S)
    wait_for_states(drone, tmp_path, flight)
    take_off(drone)
    reader = subprocess.Popen([sys.executable, "-c", READS_ALL], cwd=pathlib.Path(__file__).parent, stdout=subprocess.PIPE,
                              preexec_fn=die_with_parent)
    assert reader.stdout.readline() == b"reads\n"
    reader.send_signal(signal.SIGSTOP)
    stands_since = time.monotonic()
    time.sleep(5)
    stands_until = time.monotonic()
    reader.kill()
    reader.wait()
    drone.say("stop")
    wait_down(drone)
    time.sleep(2)
    drone.say("takeoff")
    drone.cmd_vel.wait_for_reader().say(Twist(Vector3(0.4, 0.0, 0.0), Vector3()))
    time.sleep(3)
    assert drone.height() < 0.15, "a stop stands until it is cleared"
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert "Waiting for a pilot's ROS 2 messages: /tello1/takeoff" in printed(tmp_path)
    assert re.search(r"tello1 +stopped by Org2MSP CN=User1@org2", printed(tmp_path)), "the report names who stopped it"
    assert re.search("no take-off: it is stopped by Org2MSP CN=User1@org2", (tmp_path / "run" / "ground.log").read_text())
    flown = [t for t, _ in applied(tmp_path, 1) if stands_since < t < stands_until]
    assert len(flown) > 25, "a reader that stands still holds nobody up"
    pilot = pilot_counts(tmp_path, 0)
    assert pilot["refused"] == 1 and pilot["not_flying"] == 1, pilot
    assert_nothing_left()
