"""Messages of ROS 2 and a participant, as somebody else has them: PyPI's cyclonedds, and the messages that the example of a
controller brings along."""
import pathlib
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "hil/fault/examples"))
from ros2_messages import Empty, Header, Odometry, Pose, Quaternion, Time, Twist, Vector3

TIMEOUT_S = 60  # not a limit on speed: only how long a broken test may take


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class Imu(IdlStruct, typename="sensor_msgs::msg::dds_::Imu_"):
    header: Header
    orientation: Quaternion
    orientation_covariance: array[float64, 9]
    angular_velocity: Vector3
    angular_velocity_covariance: array[float64, 9]
    linear_acceleration: Vector3
    linear_acceleration_covariance: array[float64, 9]


@dataclass
class BatteryState(IdlStruct, typename="sensor_msgs::msg::dds_::BatteryState_"):
    header: Header
    voltage: float32
    temperature: float32
    current: float32
    charge: float32
    capacity: float32
    design_capacity: float32
    percentage: float32
    power_supply_status: uint8
    power_supply_health: uint8
    power_supply_technology: uint8
    present: bool
    cell_voltage: sequence[float32]
    cell_temperature: sequence[float32]
    location: str
    serial_number: str


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


LOOPBACK = """<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>
</General></Domain></CycloneDDS>"""


def qos(*more) -> Qos:
    """ROS 2's defaults: reliable, keep the last 10; CDR as ROS 2 writes it."""
    return Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10),
               Policy.DataRepresentation(use_cdrv0_representation=True), *more)


class Writer:
    def __init__(self, participant: DomainParticipant, topic: str, kind: type):
        self.writer = DataWriter(participant, Topic(participant, "rt" + topic, kind, qos=qos()), qos=qos())
        self.matched = False

    def wait_for_reader(self) -> "Writer":
        deadline = time.monotonic() + TIMEOUT_S
        while not self.writer.get_matched_subscriptions():
            assert time.monotonic() < deadline, "nobody reads this topic"
            time.sleep(0.02)
        if not self.matched:
            time.sleep(1)  # the reader has yet to find the writer, and hears nothing from before that
            self.matched = True
        return self

    def say(self, message) -> None:
        self.writer.write(message)


class Reader:
    """Everything that came, and when."""

    def __init__(self, participant: DomainParticipant, topic: str, kind: type, *more_qos):
        self.kind, self.topic = kind, topic
        self.reader = DataReader(participant, Topic(participant, "rt" + topic, kind, qos=qos()), qos=qos(*more_qos))
        self.came = []

    def take(self) -> list:
        for sample in self.reader.take(100):
            if isinstance(sample, self.kind):
                self.came.append((time.monotonic(), sample))
        return [sample for _, sample in self.came]

    def newest(self):
        """The next one from now on."""
        count = len(self.take())
        return self.wait(lambda all: all[-1] if len(all) > count else None)

    def wait(self, look, timeout_s: float = TIMEOUT_S):
        """Until `look(all that came)` is something."""
        deadline = time.monotonic() + timeout_s
        while True:
            found = look(self.take())
            if found:
                return found
            assert time.monotonic() < deadline, f"{self.topic}: {len(self.came)} messages, none that is waited for; {self.came[-1:]}"
            time.sleep(0.01)


class Outsider:
    """A participant on loopback, or where `cyclone_config` says."""

    def __init__(self, domain: int = 0, cyclone_config: str = LOOPBACK):
        self.domain = Domain(domain, cyclone_config)
        self.participant = DomainParticipant(domain)

    def reads(self, topic: str, kind: type, *more_qos) -> Reader:
        return Reader(self.participant, topic, kind, *more_qos)

    def writes(self, topic: str, kind: type) -> Writer:
        return Writer(self.participant, topic, kind)
