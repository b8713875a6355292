"""What goes over the wire, on both its ends: JSON in the robots' own frame, which is not SOTER's.

The robots think like surveyors: north and east in metres, headings in degrees clockwise from north, charge in per
cent. Turning that into east and north, radians counter-clockwise from east and a charge from 0 to 1 is the adapter's
business, and `heading_rad` and `compass_deg` are the only two functions that do it.

A command is not an event but the whole of what the robot is to do, numbered. So one that is lost is made good by the
next, one that comes twice or too late is known by its number, and a socket needs to keep only the last.
"""

from __future__ import annotations

import json
import math
from typing import Any, Final, NamedTuple

LEASE_S: Final = 0.15
"""A robot moves for this long after its lease was renewed, in its own time."""

PERIOD_S: Final = 0.02
"""A robot controls itself, and reports, once in this time."""

V_MAX_M_S: Final = 0.22
YAW_RATE_MAX_RAD_S: Final = 2.84
BRAKE_M_S2: Final = 1.0
BODY_RADIUS_M: Final = 0.105

CONTROLLERS: Final = ("AC", "SC")


class GoalMessage(NamedTuple):
    """Where to go.

    Attributes:
        id: number, unique within a session.
        by: the controller that asks, "AC" or "SC".
        north_m: metres north.
        east_m: metres east.
        heading_deg: the heading to arrive with, or None.
        speed_m_s: a cap on the speed, or None.
    """

    id: int
    by: str
    north_m: float
    east_m: float
    heading_deg: float | None
    speed_m_s: float | None


class Command(NamedTuple):
    """All that a robot is to do.

    Attributes:
        session: names who commands; a robot listens to one at a time.
        seq: grows with each command of a session.
        lease_s: the robot's own time from which its lease counts, as far as the sender knows; None ends the lease.
        controller: who is in charge, "AC" or "SC".
        goal: where to go, or None: stop.
    """

    session: str
    seq: int
    lease_s: float | None
    controller: str
    goal: GoalMessage | None

    def encode(self) -> bytes:
        """Return the message."""
        goal = None if self.goal is None else self.goal._asdict()
        return json.dumps(self._replace(goal=None)._asdict() | {"goal": goal}).encode()

    @staticmethod
    def decode(message: bytes) -> Command:
        """Read a message.

        Raises:
            ValueError: it is none, or a number in it is none.
        """
        values = _mapping(json.loads(message))
        goal = values.get("goal")
        return Command(
            str(values.get("session", "")),
            int(_number(values, "seq")),
            _number_or_none(values, "lease_s"),
            _controller(values, "controller"),
            None if goal is None else _goal(_mapping(goal)),
        )


class Report(NamedTuple):
    """How a robot is, sent once a period.

    Attributes:
        robot: its number.
        boot: names the time since it was switched on; another means that its clock began anew.
        session: whose commands it follows; empty for nobody's.
        seq: the last command that it has taken.
        stamp_s: its own time, from its start.
        north_m: where it is.
        east_m: the same.
        heading_deg: clockwise from north.
        north_m_s: velocity.
        east_m_s: the same.
        turn_deg_s: clockwise.
        charge_percent: 0 to 100.
        controller: who is in charge, "AC" or "SC".
        goal: number of the goal that it works on, or None.
    """

    robot: int
    boot: str
    session: str
    seq: int
    stamp_s: float
    north_m: float
    east_m: float
    heading_deg: float
    north_m_s: float
    east_m_s: float
    turn_deg_s: float
    charge_percent: float
    controller: str
    goal: int | None

    def encode(self) -> bytes:
        """Return the message."""
        return json.dumps(self._asdict()).encode()

    @staticmethod
    def decode(message: bytes) -> Report:
        """Read a message.

        Raises:
            ValueError: it is none, or a number in it is none.
        """
        values = _mapping(json.loads(message))
        goal = _number_or_none(values, "goal")
        return Report(
            int(_number(values, "robot")),
            str(values.get("boot", "")),
            str(values.get("session", "")),
            int(_number(values, "seq")),
            _number(values, "stamp_s"),
            _number(values, "north_m"),
            _number(values, "east_m"),
            _number(values, "heading_deg"),
            _number(values, "north_m_s"),
            _number(values, "east_m_s"),
            _number(values, "turn_deg_s"),
            _number(values, "charge_percent"),
            _controller(values, "controller"),
            None if goal is None else int(goal),
        )


def compass_deg(heading_rad: float) -> float:
    """Return a heading counter-clockwise from east, in radians, as degrees clockwise from north in [0, 360)."""
    return (90.0 - math.degrees(heading_rad)) % 360.0


def heading_rad(compass_deg: float) -> float:
    """Return a heading in degrees clockwise from north as radians counter-clockwise from east in (-pi, pi]."""
    angle_rad = math.radians(90.0 - compass_deg)
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


def _goal(values: dict[str, Any]) -> GoalMessage:
    return GoalMessage(
        int(_number(values, "id")),
        _controller(values, "by"),
        _number(values, "north_m"),
        _number(values, "east_m"),
        _number_or_none(values, "heading_deg"),
        _number_or_none(values, "speed_m_s"),
    )


def _mapping(value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"not an object: {value!r}")  # noqa: TRY004 - bad input, whatever its type
    return value


def _number(values: dict[str, Any], name: str) -> float:
    value = values.get(name)
    # JSON has no NaN, but Python's reader takes it.
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, which is no number")
    return float(value)


def _number_or_none(values: dict[str, Any], name: str) -> float | None:
    return None if values.get(name) is None else _number(values, name)


def _controller(values: dict[str, Any], name: str) -> str:
    value = values.get(name)
    if value not in CONTROLLERS:
        raise ValueError(f"{name} is {value!r}, allowed: {' or '.join(CONTROLLERS)}")
    return str(value)
