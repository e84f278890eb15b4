"""The binary traces that every program writes: common/rt/trace.hpp, in Python once for tools and tests."""
import enum
import pathlib
import struct
from typing import NamedTuple

MAGIC = b"LLTRACE1"
HEADER = struct.Struct("<8sQ")  # MAGIC, bytes of a record
RECORD = struct.Struct("<qHHIQq4d")


class TraceKind(enum.IntEnum):
    """scripts/check-traces holds these against the header."""
    TRUTH = 1
    STATE_SAMPLED = 2
    BATCH_SUBMITTED = 3
    BATCH_COMMITTED = 4
    STATE_RECEIVED = 5
    COMMAND_MADE = 6
    COMMAND_VERIFIED = 7
    COMMAND_APPLIED = 8
    MODE = 9
    REFUSED = 10
    STATE_TAKEN = 11
    STATE_BATCHED = 12
    CALL_ENDORSED = 13
    CALL_ORDERED = 14
    COMMAND_SUBMITTED = 15
    COMMAND_IN_BLOCK = 16
    COMMAND_TAKEN = 17
    PLAN_RECEIVED = 18
    SETPOINT_SENT = 19
    LOOP_TURNS = 20
    RC_SENT = 21
    POSE_REPORTED = 22
    SETPOINT_LEFT = 23


class Record(NamedTuple):
    t_ns: int
    kind: int
    drone: int
    extra: int
    id: int
    stamp_ns: int
    v0: float
    v1: float
    v2: float
    v3: float


def whole_records(file: pathlib.Path) -> bytes:
    """Behind the header; a torn last record (a killed writer) is left out."""
    data = file.read_bytes()
    if len(data) < HEADER.size:
        return b""
    if HEADER.unpack_from(data) != (MAGIC, RECORD.size):
        raise ValueError(f"{file}: no trace of this version")
    data = data[HEADER.size:]
    return data[:len(data) // RECORD.size * RECORD.size]


def records(file: pathlib.Path) -> list[Record]:
    return [Record._make(values) for values in RECORD.iter_unpack(whole_records(file))]
