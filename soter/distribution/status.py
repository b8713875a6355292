"""The status that a process publishes at every tick: its robots, and echoes of what it has heard. MessagePack.

Decoded into these types or refused. Times are in seconds of the sender's own fleet time unless said otherwise.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

import msgspec

from soter.errors import Garbage
from soter.isolation.messages import Id, Text, decoded
from soter.sdk import RobotState
from soter.sdk.values import MAX_COORDINATE_M

VERSION: Final = 3
"""Version of statuses and messages; processes of different versions do not exchange any."""

MAX_STATUS_BYTES: Final = 1 << 15
MAX_ROBOTS: Final = 64
MAX_ECHOES: Final = 64

_AHEAD_S: Final = 0.1
"""How far a stamp may be ahead of the sender's clock, as for any robot."""

Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]


class Echo(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The sending time of the latest status heard from another process, and how long ago it came.

    Attributes:
        process: the other process.
        epoch: its start.
        sent_s: the `sent_s` of its status, in its own time.
        held_s: the longest time since that status came.
    """

    process: Text
    epoch: Id
    sent_s: float
    held_s: Seconds


class RobotStatus(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One robot of the sender.

    Attributes:
        state: its latest sample.
        engaged: whether its AC is active.
        driver: the module that drives it; empty for the AC.
        needs_charge: whether it is on its way to charge, with a low charge.
    """

    state: RobotState
    engaged: bool
    driver: Text
    needs_charge: bool


class Status(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One process at one tick.

    Attributes:
        process: the sender.
        epoch: the sender's start; a number that no other start has.
        mission: the sender's mission.
        serial: counts the statuses of this start.
        sent_s: when it was sent.
        robots: all robots that the sender supervises.
        echoes: of all processes that the sender has heard recently.
    """

    process: Text
    epoch: Id
    mission: Text
    serial: Id
    sent_s: float
    robots: Annotated[tuple[RobotStatus, ...], msgspec.Meta(max_length=MAX_ROBOTS)] = ()
    echoes: Annotated[tuple[Echo, ...], msgspec.Meta(max_length=MAX_ECHOES)] = ()


_status: Final = msgspec.msgpack.Decoder(Status)


def decode_status(data: bytes) -> Status:
    """Return the status in bytes, after a check of its numbers.

    Raises:
        Garbage: the bytes are no status, or a number is not finite or absurd.
    """
    status = decoded(_status, data, MAX_STATUS_BYTES, "status")
    if not math.isfinite(status.sent_s) or not all(math.isfinite(echo.sent_s) for echo in status.echoes):
        raise Garbage("a time that is not finite")
    for robot in status.robots:
        _check(robot.state, status.sent_s)
    return status


def _check(state: RobotState, sent_s: float) -> None:
    numbers = (state.x_m, state.y_m, state.z_m, state.heading_rad, state.vx_m_s, state.vy_m_s, state.yaw_rate_rad_s)
    if not all(-MAX_COORDINATE_M <= number <= MAX_COORDINATE_M for number in (*numbers, state.vz_m_s or 0.0)):
        raise Garbage(f"a state of robot {state.robot_id} that is not finite, or absurd")
    if state.battery is not None and not 0.0 <= state.battery <= 1.0:
        raise Garbage(f"a charge of robot {state.robot_id} that is none")
    if not -math.inf < state.stamp_s <= sent_s + _AHEAD_S or not math.isfinite(state.vehicle_stamp_s):
        raise Garbage(f"a stamp of robot {state.robot_id} that is not finite, or ahead of its clock")
