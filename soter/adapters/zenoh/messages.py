"""The ROS messages that go over Zenoh, and their encoding, CDR.

zenoh-bridge-ros2dds passes the messages of ROS 2 nodes on unchanged: CDR version 1 behind a header of 4 bytes. These
classes have the fields of the ROS messages of the same name, and `encode` writes byte for byte what rclpy writes,
except for the gaps between fields, zero here and arbitrary in ROS. This module imports neither ROS 2 nor Zenoh.
"""

# No postponed annotations: pycdr2 reads the types of the fields when a class is made.
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, TypeVar

from pycdr2 import IdlStruct
from pycdr2._support import Buffer, Endianness  # what serialize() takes
from pycdr2.types import array, float32, float64, int32, sequence, uint8, uint32

MAX_BYTES: Final = 65536
"""Longest message, which bounds every text and list in it; longer payloads are refused unread."""

_HEADER_BYTES: Final = 4
_MOST_PADDING_BYTES: Final = 3  # DDS fills payloads up to a multiple of four

_Covariance = Annotated[Sequence[float], array(float64, 36)]
_Floats = Annotated[Sequence[float], sequence(float32)]


class Foreign(ValueError):
    """A payload is not a message of the expected kind; the error's text says how that is known."""


def _zeros() -> list[float]:
    return [0.0] * 36


@dataclass(frozen=True)
class Time(IdlStruct):
    """builtin_interfaces/Time: seconds and nanoseconds."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass(frozen=True)
class RosClock(IdlStruct):
    """rosgraph_msgs/Clock."""

    clock: Time = Time()


@dataclass(frozen=True)
class Header(IdlStruct):
    """std_msgs/Header."""

    stamp: Time = Time()
    frame_id: str = ""


@dataclass(frozen=True)
class String(IdlStruct):
    """std_msgs/String."""

    data: str = ""


@dataclass(frozen=True)
class Vector3(IdlStruct):
    """geometry_msgs/Vector3."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass(frozen=True)
class Twist(IdlStruct):
    """geometry_msgs/Twist: m/s and rad/s in the robot's own frame, x ahead and y to the left."""

    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


@dataclass(frozen=True)
class TwistStamped(IdlStruct):
    """geometry_msgs/TwistStamped."""

    header: Header = Header()
    twist: Twist = Twist()


@dataclass(frozen=True)
class Point(IdlStruct):
    """geometry_msgs/Point, in metres."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass(frozen=True)
class Quaternion(IdlStruct):
    """geometry_msgs/Quaternion; the default is no rotation."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass(frozen=True)
class Pose(IdlStruct):
    """geometry_msgs/Pose."""

    position: Point = Point()
    orientation: Quaternion = Quaternion()


@dataclass(frozen=True)
class PoseWithCovariance(IdlStruct):
    """geometry_msgs/PoseWithCovariance."""

    pose: Pose = Pose()
    covariance: _Covariance = field(default_factory=_zeros)


@dataclass(frozen=True)
class TwistWithCovariance(IdlStruct):
    """geometry_msgs/TwistWithCovariance."""

    twist: Twist = Twist()
    covariance: _Covariance = field(default_factory=_zeros)


@dataclass(frozen=True)
class Odometry(IdlStruct):
    """nav_msgs/Odometry: the pose in the frame `header.frame_id`, the twist in the frame `child_frame_id`."""

    header: Header = Header()
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(frozen=True)
class BatteryState(IdlStruct):
    """sensor_msgs/BatteryState: V, degrees Celsius, A, Ah; `percentage` is from 0 to 1."""

    header: Header = Header()
    voltage: float32 = 0.0
    temperature: float32 = 0.0
    current: float32 = 0.0
    charge: float32 = 0.0
    capacity: float32 = 0.0
    design_capacity: float32 = 0.0
    percentage: float32 = 0.0
    power_supply_status: uint8 = 0
    power_supply_health: uint8 = 0
    power_supply_technology: uint8 = 0
    present: bool = False
    cell_voltage: _Floats = field(default_factory=list)
    cell_temperature: _Floats = field(default_factory=list)
    location: str = ""
    serial_number: str = ""


KINDS: Final = (BatteryState, RosClock, Odometry, String, Twist, TwistStamped)
"""The messages that have a key of their own."""

Message = TypeVar("Message", BatteryState, RosClock, Odometry, String, Twist, TwistStamped)


def encode(message: Message) -> bytes:
    """Return a message as CDR, in the byte order of nearly all computers, little endian. From any thread.

    Raises:
        ValueError: a value does not fit its field, or the message is longer than `MAX_BYTES`.
    """
    try:
        # A new buffer: pycdr2's own buffer of a kind could be written to by two threads.
        payload = message.serialize(buffer=Buffer(), endianness=Endianness.Little)
    except Exception as failure:
        cause = failure.__cause__ or failure
        raise ValueError(f"{type(message).__name__} cannot be encoded: {failure} ({cause})") from failure
    if len(payload) > MAX_BYTES:
        raise ValueError(f"{type(message).__name__} takes {len(payload)} bytes, allowed: at most {MAX_BYTES}")
    return payload


def decode(kind: type[Message], payload: bytes) -> Message:
    """Return a payload as a message of a kind. From any thread; the cost is bounded for any payload.

    Numbers come as they are, infinite and NaN ones too, which the caller has to check.

    Raises:
        Foreign: the payload is no message of this kind.
    """
    name, length = kind.__name__, len(payload)
    if length > MAX_BYTES:
        raise Foreign(f"{length} bytes, {name} has at most {MAX_BYTES}")
    if length < _HEADER_BYTES or payload[0] != 0 or payload[1] > 1:
        raise Foreign(f"it begins with '{payload[:_HEADER_BYTES].hex(' ')}', CDR begins with '00 00' or '00 01'")
    try:
        message = kind.deserialize(payload)
        expected = len(message.serialize(buffer=Buffer()))
    except Exception as failure:  # on foreign bytes the decoder raises anything
        raise Foreign(f"{length} bytes that are no {name}: {type(failure).__name__}: {failure}") from failure
    # Another message may begin like a message of this kind.
    if not expected <= length <= expected + _MOST_PADDING_BYTES:
        raise Foreign(f"{length} bytes, as a {name} it would have {expected}")
    return message


# pycdr2 makes the reader and writer of a kind at its first use, and marks them as ready too early: a second thread
# would take a good message for a foreign one. At import there is only one thread.
for _kind in KINDS:
    _made: Any = _kind
    decode(_made, encode(_made()))
