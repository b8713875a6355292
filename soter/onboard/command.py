"""What SOTER and a robot that drives to goals by itself tell each other, whatever carries it.

A command is not an event but all that the robot is to do, numbered: one that is lost is made good by the next, one that
comes twice or too late is known by its number, and nobody needs a queue. Everything is in SOTER's frame: metres east,
north and up, radians counter-clockwise from east. `encode` and `decode` are JSON; a robot that speaks otherwise has an
adapter that translates.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from soter.onboard.wire import (
    GateReport,
    as_object,
    read_controller,
    read_count,
    read_number,
    read_object,
    read_optional,
    read_text,
)


class GoalMessage(NamedTuple):
    """Where to go; a `soter.onboard.drive.Target`.

    Attributes:
        id: its number, unique within a session.
        by: the controller that asks, "AC" or "SC".
        x_m: east.
        y_m: north.
        z_m: up.
        heading_rad: the heading to arrive with, or None.
        speed_m_s: a cap on the speed, or None.
    """

    id: int
    by: str
    x_m: float
    y_m: float
    z_m: float = 0.0
    heading_rad: float | None = None
    speed_m_s: float | None = None


class Command(NamedTuple):
    """All that a robot is to do.

    Attributes:
        session: names the program that commands; a robot follows one at a time.
        seq: grows with each command of a session.
        controller: who is in charge, "AC" or "SC".
        clock: names the robot's clock that `renewed_s` is a time of, as the robot reported it.
        renewed_s: when the lease was renewed, by that clock, as far as the sender knows; None ends the lease.
        goal: where to go, or None: stop.
    """

    session: str
    seq: int
    controller: str
    clock: str
    renewed_s: float | None
    goal: GoalMessage | None

    def encode(self) -> bytes:
        """Return the message."""
        goal = None if self.goal is None else self.goal._asdict()
        return json.dumps(self._asdict() | {"goal": goal}).encode()

    @staticmethod
    def decode(message: bytes) -> Command:
        """Read a message.

        Raises:
            ValueError: it is none; nothing else is ever raised.
        """
        return Command.read(read_object(message))

    @staticmethod
    def read(values: Mapping[str, Any]) -> Command:
        """Read a command by the names of its fields, or raise ValueError; for wires that are not JSON."""
        goal = values.get("goal")
        return Command(
            read_text(values, "session"), read_count(values, "seq"), read_controller(values),
            read_text(values, "clock"), read_optional(values, "renewed_s"),
            None if goal is None else _goal(as_object(goal)),
        )  # fmt: skip


class Report(NamedTuple):
    """How a robot is, said once a period.

    Attributes:
        robot: its number.
        clock: names the clock that `stamp_s` is a time of; another name means that it began anew, or was set back.
        stamp_s: the robot's time at which it was so.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        vx_m_s: velocity, east.
        vy_m_s: velocity, north.
        yaw_rate_rad_s: counter-clockwise.
        battery: charge from 0 to 1, or None where it is unknown.
        gate: whom it follows.
        goal: number of the goal that it works on, or None.
        z_m: up.
        vz_m_s: velocity, up, or None.
    """

    robot: int
    clock: str
    stamp_s: float
    x_m: float
    y_m: float
    heading_rad: float
    vx_m_s: float
    vy_m_s: float
    yaw_rate_rad_s: float
    battery: float | None
    gate: GateReport
    goal: int | None
    z_m: float = 0.0
    vz_m_s: float | None = None

    def encode(self) -> bytes:
        """Return the message."""
        return json.dumps(self._asdict() | {"gate": self.gate._asdict()}).encode()

    @staticmethod
    def decode(message: bytes) -> Report:
        """Read a message.

        Raises:
            ValueError: it is none; nothing else is ever raised.
        """
        return Report.read(read_object(message))

    @staticmethod
    def read(values: Mapping[str, Any]) -> Report:
        """Read a report by the names of its fields, or raise ValueError; for wires that are not JSON."""
        return Report(
            read_count(values, "robot"), read_text(values, "clock"), read_number(values, "stamp_s"),
            read_number(values, "x_m"), read_number(values, "y_m"), read_number(values, "heading_rad"),
            read_number(values, "vx_m_s"), read_number(values, "vy_m_s"), read_number(values, "yaw_rate_rad_s"),
            read_optional(values, "battery"), GateReport.read(as_object(values.get("gate"))),
            None if values.get("goal") is None else read_count(values, "goal"),
            read_number(values, "z_m"), read_optional(values, "vz_m_s"),
        )  # fmt: skip


def _goal(values: Mapping[str, Any]) -> GoalMessage:
    return GoalMessage(
        read_count(values, "id"), read_controller(values, "by"), read_number(values, "x_m"),
        read_number(values, "y_m"), read_number(values, "z_m"), read_optional(values, "heading_rad"),
        read_optional(values, "speed_m_s"),
    )  # fmt: skip
