"""CDR as it is read and written; that it is what ROS 2 writes is told in tests/adapters/ros2/test_cdr.py."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pycdr2._support import Endianness

from soter.adapters.zenoh.messages import (
    KINDS,
    MAX_BYTES,
    BatteryState,
    Foreign,
    Header,
    Odometry,
    RosClock,
    String,
    Time,
    Twist,
    TwistStamped,
    Vector3,
    decode,
    encode,
)

EXAMPLES: tuple[Any, ...] = (
    Twist(linear=Vector3(x=0.22), angular=Vector3(z=-2.84)),
    TwistStamped(header=Header(frame_id="base_link"), twist=Twist(linear=Vector3(x=0.1))),
    Odometry(header=Header(Time(17, 250_000_000), "odom"), child_frame_id="base_footprint"),
    BatteryState(percentage=0.5, present=True, cell_voltage=[3.5, 3.25], location="slot", serial_number="7"),
    RosClock(Time(1, 2)),
    String('{"by": "AC"}'),
)

CELLS_AT = 52
"""Where a battery's first list begins, with its length, if the header names no frame."""


def test_there_is_an_example_of_every_kind() -> None:
    assert {type(each) for each in EXAMPLES} == set(KINDS)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda each: type(each).__name__)
def test_a_message_comes_back(message: Any) -> None:
    assert decode(type(message), encode(message)) == message


def test_the_bytes_of_a_velocity_are_those_of_the_standard() -> None:
    message = Twist(linear=Vector3(x=0.5), angular=Vector3(z=-1.0))
    assert encode(message) == bytes.fromhex("00 01 00 00") + struct.pack("<6d", 0.5, 0, 0, 0, 0, -1.0)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda each: type(each).__name__)
def test_the_other_byte_order_is_read_too(message: Any) -> None:
    payload = message.serialize(endianness=Endianness.Big)
    assert payload[:2] == b"\0\0"
    assert decode(type(message), payload) == message


def test_numbers_that_cannot_be_meant_are_for_the_caller_to_judge() -> None:
    found = decode(Twist, encode(Twist(linear=Vector3(math.nan, math.inf, -math.inf))))
    assert math.isnan(found.linear.x)
    assert (found.linear.y, found.linear.z) == (math.inf, -math.inf)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda each: type(each).__name__)
def test_padding_is_no_part_of_a_message(message: Any) -> None:
    payload = encode(message)
    for filled in range(4):
        # DDS notes the number of these bytes in the second half of the header.
        padded = payload[:2] + bytes([0, filled]) + payload[4:] + bytes(filled)
        assert decode(type(message), padded) == message
    with pytest.raises(Foreign, match=f"{len(payload) + 4} bytes, as a {type(message).__name__} it would have"):
        decode(type(message), payload + bytes(4))


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda each: type(each).__name__)
def test_every_truncated_message_is_foreign(message: Any) -> None:
    payload = encode(message)
    for length in range(len(payload)):
        with pytest.raises(Foreign):
            decode(type(message), payload[:length])


@pytest.mark.parametrize(
    ("kind", "payload", "why"),
    [
        (Twist, b"", "it begins with ''"),
        (Twist, b"\0\7\0\0" + bytes(48), "it begins with '00 07 00 00', CDR begins with '00 00' or '00 01'"),
        (Twist, b'{"linear": {"x": 0.1}}', "it begins with '7b 22 6c 69'"),
        (Twist, bytes(MAX_BYTES + 1), f"{MAX_BYTES + 1} bytes, Twist has at most {MAX_BYTES}"),
        (Twist, encode(EXAMPLES[2]), "bytes, as a Twist it would have 52"),
        (String, bytes.fromhex("00010000 05000000 fffefdfc 00"), "13 bytes that are no String: UnicodeDecodeError"),
        (String, bytes.fromhex("00010000 ffffffff 41414100"), "12 bytes that are no String"),
        (BatteryState, encode(EXAMPLES[3])[:CELLS_AT] + b"\xff" * 40, "92 bytes that are no BatteryState"),
    ],
)
def test_what_is_no_such_message_says_why(kind: Any, payload: bytes, why: str) -> None:
    with pytest.raises(Foreign) as found:
        decode(kind, payload)
    assert why in str(found.value)


def _mutated() -> st.SearchStrategy[bytes]:
    def mutate(payload: bytes, where: int, what: bytes) -> bytes:
        start = where % len(payload)
        return payload[:start] + what + payload[start + len(what) :]

    return st.builds(
        mutate, st.sampled_from(EXAMPLES).map(encode), st.integers(0, 10_000), st.binary(min_size=1, max_size=8)
    )


@pytest.mark.parametrize("kind", KINDS, ids=lambda each: each.__name__)
@given(payload=st.one_of(st.binary(max_size=2000), st.binary(max_size=400).map(b"\0\1\0\0".__add__), _mutated()))
def test_whatever_comes_is_a_message_or_foreign(kind: Any, payload: bytes) -> None:
    try:
        found = decode(kind, payload)
    except Foreign:
        return
    assert isinstance(found, kind)
    assert len(encode(found)) <= len(payload)


@pytest.mark.parametrize("count", [2**16, 2**28, 2**32 - 1])
def test_a_long_list_that_is_announced_costs_nothing(count: int) -> None:
    payload = encode(BatteryState())[:CELLS_AT] + struct.pack("<I", count) + bytes(60_000)
    tracemalloc.start()
    try:
        with pytest.raises(Foreign):
            decode(BatteryState, payload)
        most_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most_bytes < 2_000_000


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (RosClock(Time(sec=2**31)), "Clock cannot be encoded"),
        (Twist(linear=Vector3(x="fast")), "Twist cannot be encoded"),  # type: ignore[arg-type]
        (BatteryState(percentage=1e39), "BatteryState cannot be encoded"),
        (String("\ud800"), "String cannot be encoded"),
        (String("x" * MAX_BYTES), f"String takes {MAX_BYTES + 9} bytes, allowed: at most {MAX_BYTES}"),
    ],
)
def test_what_does_not_fit_is_not_sent(message: Any, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        encode(message)


def test_threads_do_not_write_into_each_others_messages() -> None:
    messages = [String(str(number) * (number % 300)) for number in range(2000)]
    with ThreadPoolExecutor(8) as pool:
        assert [decode(String, each) for each in pool.map(encode, messages)] == messages


RACE = """
import sys, threading
from soter.adapters.zenoh.messages import KINDS, Foreign, decode, encode

sys.setswitchinterval(1e-6)
begin, foreign = threading.Barrier(8), []

def hear(kind, payload):
    begin.wait()
    try:
        decode(kind, payload)
    except Foreign as failure:
        foreign.append(failure)

for kind in KINDS:
    payload = bytes.fromhex(sys.argv[1 + KINDS.index(kind)])
    threads = [threading.Thread(target=hear, args=(kind, payload)) for _ in range(8)]
    for each in threads: each.start()
    for each in threads: each.join()
sys.exit(repr(foreign) if foreign else 0)
"""


def test_threads_that_hear_their_first_messages_at_once_take_all_of_them() -> None:
    payloads = {type(each): encode(each).hex() for each in EXAMPLES}
    ended = subprocess.run(
        [sys.executable, "-c", RACE, *(payloads[kind] for kind in KINDS)], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")
