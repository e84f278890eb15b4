"""A DDS participant of PyPI's cyclonedds that knows nothing of this project: publishes or hears messages of a made-up type
on the domain ROS_DOMAIN_ID. Says what happens as lines of JSON, as ros2_client_peer does.

publish says the message for 0 again and again until it is asked to go by a line on its standard input.

cyclonedds_peer.py publish TOPIC FIRST COUNT PERIOD_MS | subscribe TOPIC COUNT | nodes NAME
"""
import json
import os
import select
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

import made_up

QOS = Qos(Policy.Reliability.Reliable(duration(seconds=10)), Policy.History.KeepLast(1000),
          Policy.DataRepresentation(use_cdrv0_representation=True))


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


def say(**line):
    print(json.dumps(line), flush=True)


def publish(participant, topic, first, count, period_ms):
    writer = DataWriter(participant, Topic(participant, "rt" + topic, made_up.Nested, QOS), QOS)
    # That one side knows the other does not mean that the other knows it.
    while not select.select([sys.stdin], [], [], 0.1)[0]:
        writer.write(made_up.message(0))
    for number in range(first, first + count):
        writer.write(made_up.message(number))
        time.sleep(period_ms / 1000)
    say(published=count)
    time.sleep(3600)  # until it is ended: a reliable writer may have to send again


def subscribe(participant, topic, count):
    understand = made_up.Nested.deserialize

    def keep_bytes(data):
        sample = understand(data)
        sample.came = bytes(data)
        return sample

    reader = DataReader(participant, Topic(participant, "rt" + topic, made_up.Nested, QOS), QOS)
    made_up.Nested.deserialize = keep_bytes
    say(ready=True)
    while count > 0:
        for sample in reader.take(100):
            say(number=sample.number, cdr=sample.came.hex())
            count -= sample.number > 0
        time.sleep(0.001)


def nodes(participant, name):
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal,
              Policy.History.KeepLast(1), Policy.DataRepresentation(use_cdrv0_representation=True))
    reader = DataReader(participant, Topic(participant, "ros_discovery_info", ParticipantEntitiesInfo, qos), qos)
    say(ready=True)
    while True:
        for sample in reader.take(100):
            for node in getattr(sample, "node_entities_info_seq", []):
                full = node.node_namespace.rstrip("/") + "/" + node.node_name
                say(node=full, readers=len(node.reader_gid_seq), writers=len(node.writer_gid_seq))
                if full == name:
                    return
        time.sleep(0.01)


def main():
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    job, arguments = sys.argv[1], sys.argv[2:]
    {"publish": lambda: publish(participant, arguments[0], *map(int, arguments[1:])),
     "subscribe": lambda: subscribe(participant, arguments[0], int(arguments[1])),
     "nodes": lambda: nodes(participant, arguments[0])}[job]()


main()
