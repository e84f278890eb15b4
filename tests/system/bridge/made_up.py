"""A made-up ROS 2 message type of nested arrays and strings, which no program of this project knows, and what a message
is for a number. ros2_client_peer has the same in Rust."""
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int16, sequence, uint8, uint32

ROS_TYPE = "made_up_msgs/msg/Nested"


@dataclass
class Inner(IdlStruct, typename="made_up_msgs::msg::dds_::Inner_"):
    small: int16
    text: str
    raw: sequence[uint8]


@dataclass
class Nested(IdlStruct, typename="made_up_msgs::msg::dds_::Nested_"):
    number: uint32
    name: str
    fixed: array[float64, 3]
    words: sequence[str]
    inners: sequence[Inner]
    pair: array[Inner, 2]


def _inner(n, k):
    return Inner((n + k) % 1000 - 500, "x" * ((n + k) % 17), [(n + k + i) % 256 for i in range((7 * n + k) % 23)])


def message(n):
    return Nested(n, f"message {n}", [n, n / 2, -n / 4], [f"word {k}" for k in range(n % 5)],
                  [_inner(n, k) for k in range(n % 4)], [_inner(n, 10), _inner(n, 11)])


def cdr(n):
    """Its bytes with the encapsulation header, little endian, as hex: what every reader must get."""
    return in_whole_words(message(n).serialize(use_version_2=False).hex())


def in_whole_words(cdr):
    """As DDS sends it. What stands on the wire behind the message (three bytes at most), and whether the header counts
    it, is the sender's choice."""
    return cdr[:4] + "0000" + cdr[8:] + "0" * (-len(cdr) % 8)
