"""What goes over Zenoh is, byte for byte, what ROS 2 writes and reads: both ways, for every kind of message.

All but the bytes between fields that align those: ROS leaves there what its memory held.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pycdr2._support import Buffer

from soter.adapters.zenoh.messages import (
    KINDS,
    MAX_BYTES,
    BatteryState,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    RosClock,
    String,
    Time,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
    decode,
    encode,
)

pytestmark = pytest.mark.rclpy

NAMES: dict[type[Any], str] = {
    BatteryState: "sensor_msgs/BatteryState",
    RosClock: "rosgraph_msgs/Clock",
    Odometry: "nav_msgs/Odometry",
    String: "std_msgs/String",
    Twist: "geometry_msgs/Twist",
    TwistStamped: "geometry_msgs/TwistStamped",
}
"""What ROS calls each kind."""

numbers = st.floats()
short_numbers = st.floats(width=32)
bytes_ = st.integers(0, 255)
# ROS ends a text at its first zero.
texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=60)
times = st.builds(Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
headers = st.builds(Header, times, texts)
vectors = st.builds(Vector3, numbers, numbers, numbers)
twists = st.builds(Twist, vectors, vectors)
covariances = st.lists(numbers, min_size=36, max_size=36)
poses = st.builds(
    Pose, st.builds(Point, numbers, numbers, numbers), st.builds(Quaternion, numbers, numbers, numbers, numbers)
)
MESSAGES: dict[type[Any], st.SearchStrategy[Any]] = {
    BatteryState: st.builds(
        BatteryState,
        headers,
        *[short_numbers] * 7,
        *[bytes_] * 3,
        st.booleans(),
        *[st.lists(short_numbers, max_size=12)] * 2,
        *[texts] * 2,
    ),
    RosClock: st.builds(RosClock, times),
    Odometry: st.builds(
        Odometry,
        headers,
        texts,
        st.builds(PoseWithCovariance, poses, covariances),
        st.builds(TwistWithCovariance, twists, covariances),
    ),
    String: st.builds(String, texts),
    Twist: twists,
    TwistStamped: st.builds(TwistStamped, headers, twists),
}


def ros_class(kind: type[Any]) -> Any:
    package, name = NAMES[kind].split("/")
    return getattr(import_module(f"{package}.msg"), name)


def fill(message: Any, ours: Any) -> Any:
    """Give a message of ROS the values of one of ours, field by field and by name."""
    assert {each.name for each in fields(ours)} == message.get_fields_and_field_types().keys()
    for each in fields(ours):
        value = getattr(ours, each.name)
        setattr(message, each.name, fill(getattr(message, each.name), value) if is_dataclass(value) else value)
    return message


def values(message: Any) -> Any:
    """All that a message of either side says, such that NaN is equal to itself."""
    if is_dataclass(message):
        return {each.name: values(getattr(message, each.name)) for each in fields(message)}
    if hasattr(message, "get_fields_and_field_types"):
        return {name: values(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if not isinstance(message, str) and hasattr(message, "__len__"):
        return [repr(float(each)) for each in message]
    return repr(float(message)) if isinstance(message, float) else message


class Marked(Buffer):
    """A buffer that is full of ones before a message is written to it."""

    def zero_out(self) -> None:
        self._bytes = bytearray(b"\xff" * self._size)


def gaps(ours: Any) -> list[int]:
    """Where the bytes are that no field is written to: those that are what the buffer was full of."""
    marked = ours.serialize(buffer=Marked(bytes(MAX_BYTES)))
    return [place for place, (one, other) in enumerate(zip(encode(ours), marked, strict=True)) if one != other]


def without(places: list[int], payload: bytes) -> bytes:
    cleared = bytearray(payload)
    for place in places:
        cleared[place] = 0
    return bytes(cleared)


def check(ours: Any) -> None:
    from rclpy.serialization import deserialize_message, serialize_message

    kind: type[Any] = type(ours)
    theirs = fill(ros_class(kind)(), ours)
    payload, payload_of_ros, between = encode(ours), serialize_message(theirs), gaps(ours)
    assert without(between, payload_of_ros) == payload
    assert values(decode(kind, payload_of_ros)) == values(theirs)
    back = deserialize_message(payload, ros_class(kind))
    assert values(back) == values(ours)
    assert without(between, serialize_message(back)) == payload


def test_every_kind_is_compared() -> None:
    assert NAMES.keys() == MESSAGES.keys() == set(KINDS)


def test_only_bytes_that_align_what_follows_are_left_out() -> None:
    assert gaps(Twist(Vector3(1.0, 2.0, 3.0), Vector3(4.0, 5.0, 6.0))) == []
    assert gaps(String("four")) == []
    # Two texts, and numbers of eight bytes behind the second: header and stamp end at 12, lengths take four.
    assert gaps(Odometry(Header(frame_id="ab"), child_frame_id="c")) == [19, *range(26, 28)]


@pytest.mark.parametrize("kind", KINDS, ids=lambda each: each.__name__)
def test_the_bytes_are_those_of_ros(kind: type[Any]) -> None:
    @given(MESSAGES[kind])
    def compare(ours: Any) -> None:
        check(ours)

    compare()


@pytest.mark.parametrize("length", range(33))
def test_texts_of_any_length_leave_what_follows_in_its_place(length: int) -> None:
    header = Header(Time(1, 2), "x" * length)
    check(String("ö" * length))
    check(Odometry(header, child_frame_id="y" * length, pose=PoseWithCovariance(Pose(Point(1.0, 2.0, 3.0)))))
    check(TwistStamped(header, Twist(Vector3(0.1), Vector3(z=-0.2))))
    for other in range(4):
        cells = [3.5] * (length % 5)
        check(BatteryState(header, 12.5, cell_voltage=cells, location="z" * other, serial_number="s" * length))


def test_a_long_text_is_the_same_too() -> None:
    check(String("long " * 10_000))
