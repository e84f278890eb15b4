"""Peers on DDS with the names and QoS of ROS 2 nodes, by PyPI's cyclonedds."""
import dataclasses
import time

import cyclonedds.idl as idl
import cyclonedds.idl.types as types
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclasses.dataclass
class Text(idl.IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclasses.dataclass
class Number(idl.IdlStruct, typename="std_msgs::msg::dds_::UInt64_"):
    data: types.uint64


@dataclasses.dataclass
class Empty(idl.IdlStruct, typename="std_msgs::msg::dds_::Empty_"):
    structure_needs_at_least_one_member: types.uint8 = 0


@dataclasses.dataclass
class Pose(idl.IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    """Its members' members in a row: the same bytes."""
    sec: types.int32
    nanosec: types.uint32
    frame_id: str
    position_and_orientation: types.array[types.float64, 7]


def qos(reliable: bool = True, latched: bool = False) -> Qos:
    return Qos(Policy.Reliability.Reliable(duration(seconds=10)) if reliable else Policy.Reliability.BestEffort,
               Policy.History.KeepLast(1) if latched else Policy.History.KeepAll,
               Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile)


class Writer:
    def __init__(self, domain: int, topic: str, kind, **how):
        self.participant = DomainParticipant(domain)
        self.writer = DataWriter(self.participant, Topic(self.participant, "rt" + topic, kind), qos=qos(**how))

    def wait_for_readers(self, count: int = 1, timeout_s: float = 60) -> "Writer":
        deadline = time.monotonic() + timeout_s
        while len(self.writer.get_matched_subscriptions()) < count:
            assert time.monotonic() < deadline, "nobody reads it"
            time.sleep(0.02)
        return self

    def write(self, message, stamp_ns: int | None = None) -> None:
        self.writer.write(message, timestamp=stamp_ns)


class Reader:
    def __init__(self, domain: int, topic: str, kind, **how):
        self.participant = DomainParticipant(domain)
        self.reader = DataReader(self.participant, Topic(self.participant, "rt" + topic, kind), qos=qos(**how))

    def take(self) -> list:
        return [sample for sample in self.reader.take(N=10_000) if isinstance(sample, self.reader.topic.data_type)]

    def take_all(self, count: int, timeout_s: float = 60) -> list:
        """Until `count` have come, and those that come within a moment more."""
        taken, deadline = [], time.monotonic() + timeout_s
        while len(taken) < count and time.monotonic() < deadline:
            taken += self.take()
            time.sleep(0.01)
        time.sleep(0.3)
        return taken + self.take()
