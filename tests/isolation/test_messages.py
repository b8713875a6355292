"""What crosses comes out as it went in, and nothing else comes out at all."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.errors import Garbage
from soter.isolation.messages import (
    MAX_ANNOUNCED,
    MAX_TEXT,
    MAX_TURN_BYTES,
    Ask,
    Begin,
    Begun,
    Busy,
    Down,
    FailedForGood,
    Footprint,
    Moved,
    Reported,
    Started,
    TargetEndedMessage,
    TargetGiven,
    Tick,
    Turn,
    Up,
    decode_down,
    decode_up,
    encode,
)
from soter.isolation.refused import Refused
from soter.rta import ControlReport, GoalReport
from soter.sdk import Waypoint
from tests.isolation.ends import state

TURN = Turn(
    3,
    (Ask(1, 2, 7, Waypoint(1.0, math.inf, heading_rad=0.5), (Waypoint(2.0, 3.0),)),),
    (TargetGiven(1, 4, 1.0, 2.0), TargetEndedMessage(2, 3, "reached")),
    (FailedForGood(None, "all"), FailedForGood(2, "one")),
    ("slow",),
    5,
    (Moved(1.5, "TaskPlanner", 1, "local", "Starting", "Running", "", ""),),
)


@pytest.mark.parametrize(
    "message", [Started(), Begun(), Refused("config", "no", "a.toml", 3, "planner"), TURN, Busy("A.b")]
)
def test_what_a_mission_says_comes_through(message: Up) -> None:
    assert decode_up(encode(message)) == message


@pytest.mark.parametrize(
    "message",
    [
        Begin(1.0, 2.0, (1, 2), (Footprint(0.1, 0.5, 0.1), Footprint(0.2, 0.6, 0.3))),
        Tick(
            9,
            1.0,
            1.1,
            2.0,
            (state(1), None),
            (Reported(goal=GoalReport(1, 2, "reached")), Reported(control=ControlReport(2, False, "geofence", "why"))),
        ),
    ],
)
def test_what_a_supervisor_says_comes_through(message: Down) -> None:
    assert decode_down(encode(message)) == message


def test_numbers_that_make_no_sense_come_through_as_what_they_are() -> None:
    decoded = decode_up(encode(Turn(1, (Ask(1, 0, 1, Waypoint(math.nan, -math.inf)),))))
    assert isinstance(decoded, Turn)
    target = decoded.asks[0].target
    assert type(target) is Waypoint
    assert math.isnan(target.x_m)
    assert target.y_m == -math.inf


def test_long_causes_are_cut() -> None:
    cut = Reported.of(ControlReport(1, False, "m", "x" * 10_000)).control
    assert cut is not None
    assert cut == (1, False, "m", "x" * MAX_TEXT)


WRONG: dict[str, object] = {
    "nothing": None,
    "text": "turn",
    "another tag": ["turns", 1],
    "too few": ["turn"],
    "too many": ["turn", 1, [], [], [], [], 0, [], 0],
    "negative tick": ["turn", -1],
    "huge tick": ["turn", 2**63],
    "tick that is a text": ["turn", "1"],
    "tick that is a truth": ["turn", True],
    "waypoint without y": ["turn", 1, [[1, 0, 1, [1.0]]]],
    "waypoint of texts": ["turn", 1, [[1, 0, 1, ["1", "2"]]]],
    "waypoint with a list in it": ["turn", 1, [[1, 0, 1, [1.0, [2.0]]]]],
    "too much announced": ["turn", 1, [[1, 0, 1, [1.0, 2.0], [[1.0, 2.0]] * (MAX_ANNOUNCED + 1)]]],
    "long text": ["busy", "x" * (MAX_TEXT + 1)],
    "failure of a text": ["turn", 1, [], [], [["1", "why"]]],
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_what_was_not_agreed_is_garbage(wrong: object) -> None:
    with pytest.raises(Garbage):
        decode_up(msgspec.msgpack.encode(wrong))


def test_what_is_too_long_is_garbage() -> None:
    with pytest.raises(Garbage, match=str(MAX_TURN_BYTES)):
        decode_up(bytes(MAX_TURN_BYTES + 1))


def test_what_is_nested_without_end_is_garbage() -> None:
    with pytest.raises(Garbage):
        decode_up(b"\x91" * MAX_TURN_BYTES)


def decoded(data: bytes) -> Up | None:
    """What bytes mean, or None for garbage."""
    try:
        return decode_up(data)
    except Garbage:
        return None


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_garbage(data: bytes) -> None:
    message = decoded(data)
    assert message is None or decode_up(encode(message)) == message


@given(st.integers(0, len(encode(TURN)) - 1), st.integers(0, 255))
def test_a_message_with_one_byte_changed_is_a_message_or_garbage(at: int, value: int) -> None:
    data = bytearray(encode(TURN))
    data[at] = value
    message = decoded(bytes(data))
    assert message is None or isinstance(message, Turn)


def test_a_text_that_is_none_is_garbage() -> None:
    with pytest.raises(Garbage, match="utf-8"):
        decode_up(encode(TURN).replace(b"reached", b"\x80eached"))
