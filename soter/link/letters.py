"""Machine events between processes, in MessagePack: what a task planner and robot agents elsewhere tell each other.

Decoded into these types or refused; who sends is named by the key that it came under.
"""

from __future__ import annotations

from typing import Annotated, Final

import msgspec

from soter.link.messages import Id, Text, decoded
from soter.sdk.values import MAX_COORDINATE_M

MAX_FRAME_BYTES: Final = 1 << 14
MAX_LETTERS: Final = 16
"""Letters in one frame; the rest goes with the next."""

Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]


class _Letter(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    pass


class Visit(_Letter, tag="visit", frozen=True):
    """To a robot's process: the robot is to go there."""

    robot_id: Id
    target_id: Id
    x_m: Coordinate
    y_m: Coordinate


class Joined(_Letter, tag="joined", frozen=True):
    """To a robot's process: its robot is told of another."""

    robot_id: Id
    other_id: Id


class Ended(_Letter, tag="ended", frozen=True):
    """To the task planner's process: a robot is done with a target."""

    robot_id: Id
    target_id: Id
    outcome: Text


Letter = Visit | Joined | Ended


class Frame(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What one end of a channel sends at once.

    Attributes:
        epoch: which start of the sender this is; a number that no other start has.
        to: which start of the receiver it is meant for; 0 for whichever there is.
        mission: what the sender runs; only processes of one mission talk.
        ask: a number that the receiver is to repeat, which shows that it lives; 0 for none.
        answer: what the receiver has asked for; 0 for nothing.
        taken: up to which number the receiver's letters have been taken.
        first: number of the first letter; they are numbered from 1 without gaps.
        letters: not acknowledged yet, oldest first.
    """

    epoch: Id
    to: Id
    mission: Text
    ask: Id = 0
    answer: Id = 0
    taken: Id = 0
    first: Id = 1
    letters: Annotated[tuple[Letter, ...], msgspec.Meta(max_length=MAX_LETTERS)] = ()


_encoder: Final = msgspec.msgpack.Encoder()
_frame: Final = msgspec.msgpack.Decoder(Frame)


def encode_frame(frame: Frame) -> bytes:
    """Encode a frame."""
    return _encoder.encode(frame)


def decode_frame(data: bytes) -> Frame:
    """Decode a frame.

    Raises:
        Garbage: it is none.
    """
    return decoded(_frame, data, MAX_FRAME_BYTES, "frame")
