"""A ROS 2 controller that flies a square over a drone's topics: /tello1/odom in, takeoff, cmd_vel and land out.

    ledgerline fault run hil/scenarios/own/ros2-gap.toml --real --out runs --program 'python3 ros2_square.py'

It speaks DDS by PyPI's cyclonedds (build/venv, which ./run-tests makes, has it), so that it runs without an installed
ROS 2. With rclpy Node and its publishers and subscription stand in the place of Topics; Controller stays as it is.

A usual mistake: to integrate across a gap. Take out the line that keeps dt_s below MAX_STEP_S, and the scenario catches it.
"""
import math
import os
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from ros2_messages import Empty, Odometry, Twist, Vector3

SIDE_M, SPEED_MPS, HEIGHT_M = 1.5, 0.4, 1.0
P, I = 1.2, 0.15  # of the place: 1/s, 1/s^2
LEASH_M = 0.5  # the reference waits for a drone that is farther behind
MAX_MPS = 0.8
MAX_STEP_S = 0.1  # between two states: in a longer gap the drone hovers, and nobody knows what the error was
TIMEOUT_S = 60


class Controller:
    """PI along a square: a reference moves, and the drone is steered to it. Map frame: x east, y north."""

    def __init__(self, origin: tuple):
        self.origin, self.corners = origin, [(0, 0), (SIDE_M, 0), (SIDE_M, SIDE_M), (0, SIDE_M), (0, 0)]
        self.way_m, self.integral, self.before_s = 0.0, [0.0, 0.0], None

    def reference(self) -> tuple:
        piece = min(int(self.way_m / SIDE_M), 3)
        share = self.way_m / SIDE_M - piece
        (ax, ay), (bx, by) = self.corners[piece], self.corners[piece + 1]
        return self.origin[0] + ax + share * (bx - ax), self.origin[1] + ay + share * (by - ay)

    def step(self, stamp_s: float, at: tuple) -> list:
        """The velocity to fly, by a new place of the drone."""
        dt_s = 0.0 if self.before_s is None else stamp_s - self.before_s
        dt_s = min(dt_s, MAX_STEP_S)
        self.before_s = stamp_s
        before = self.reference()
        if math.dist(before, at) < LEASH_M:
            self.way_m = min(self.way_m + SPEED_MPS * dt_s, 4 * SIDE_M)
        goal = self.reference()
        error = [goal[k] - at[k] for k in range(2)]
        self.integral = [self.integral[k] + error[k] * dt_s for k in range(2)]
        moved = [(goal[k] - before[k]) / dt_s if dt_s > 0 else 0.0 for k in range(2)]
        wanted = [moved[k] + P * error[k] + I * self.integral[k] for k in range(2)]
        too_fast = math.hypot(*wanted) / MAX_MPS
        return [w / too_fast for w in wanted] if too_fast > 1 else wanted

    def arrived(self, at: tuple) -> bool:
        return self.way_m >= 4 * SIDE_M and math.dist(at, self.origin) < 0.15


class Topics:
    """One drone's."""

    def __init__(self, drone: str):
        self.qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10),
                       Policy.DataRepresentation(use_cdrv0_representation=True))
        self.participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        self.odom = DataReader(self.participant, self.topic(f"/{drone}/odom", Odometry), qos=self.qos)
        self.cmd_vel = DataWriter(self.participant, self.topic(f"/{drone}/cmd_vel", Twist), qos=self.qos)
        self.words = {word: DataWriter(self.participant, self.topic(f"/{drone}/{word}", Empty), qos=self.qos)
                      for word in ("takeoff", "land")}

    def topic(self, name: str, kind: type) -> Topic:
        return Topic(self.participant, "rt" + name, kind, qos=self.qos)

    def next_odom(self) -> Odometry:
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            for sample in self.odom.take(1):
                if isinstance(sample, Odometry):
                    return sample
            time.sleep(0.005)
        sys.exit(f"no odometry for {TIMEOUT_S} s")


def place(odom: Odometry) -> tuple:
    position = odom.pose.pose.position
    return position.x, position.y


def fly(topics: Topics) -> None:
    odom = topics.next_odom()
    origin = place(odom)
    asked_s = 0.0
    while odom.pose.pose.position.z < HEIGHT_M - 0.2:
        if time.monotonic() > asked_s + 3:  # the reader may not be discovered yet
            topics.words["takeoff"].write(Empty())
            asked_s = time.monotonic()
        odom = topics.next_odom()
    controller = Controller(origin)
    while not controller.arrived(place(odom)):
        stamp = odom.header.stamp
        east, north = controller.step(stamp.sec + 1e-9 * stamp.nanosec, place(odom))
        q = odom.pose.pose.orientation
        yaw = 2 * math.atan2(q.z, q.w)  # cmd_vel is in the drone's own frame
        forward, left = east * math.cos(yaw) + north * math.sin(yaw), north * math.cos(yaw) - east * math.sin(yaw)
        topics.cmd_vel.write(Twist(Vector3(forward, left, HEIGHT_M - odom.pose.pose.position.z), Vector3()))
        odom = topics.next_odom()
    while odom.pose.pose.position.z > 0.15:
        topics.words["land"].write(Empty())
        for _ in range(10):
            odom = topics.next_odom()


fly(Topics(os.environ.get("LEDGERLINE_DRONES", "tello1").split(",")[0]))
