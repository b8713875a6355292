"""The messages between SOTER and a robot that drives to goals by itself, for any middleware.

A command is no event but the robot's whole task, with a number: the next command makes good for a lost one, a double or
late one is known by its number, and no queue is needed. Everything is in SOTER's frame: metres east, north and up,
radians counter-clockwise from east. `encode` and `decode` are JSON; for robots with another format an adapter
translates.
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
    """A goal; a `soter.onboard.drive.Target`.

    Attributes:
        id: the goal's number, unique within a session.
        by: the controller that sends it, "AC" or "SC".
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
    """A robot's whole task.

    Attributes:
        session: name of the commanding program; a robot follows one at a time.
        seq: grows with each command of a session.
        controller: the active controller, "AC" or "SC".
        clock: name of the robot's clock that `renewed_s` is a time of, as the robot reported it.
        renewed_s: time of the lease's renewal, by the sender's knowledge of that clock; None ends the lease.
        goal: the goal, or None to stop.
    """

    session: str
    seq: int
    controller: str
    clock: str
    renewed_s: float | None
    goal: GoalMessage | None

    def encode(self) -> bytes:
        """Return the command as a message."""
        goal = None if self.goal is None else self.goal._asdict()
        return json.dumps(self._asdict() | {"goal": goal}).encode()

    @staticmethod
    def decode(message: bytes) -> Command:
        """Return the command in a message.

        Raises:
            ValueError: the message holds no command; nothing else is ever raised.
        """
        return Command.read(read_object(message))

    @staticmethod
    def read(values: Mapping[str, Any]) -> Command:
        """Return a command from its fields by name, or raise ValueError; for formats other than JSON."""
        goal = values.get("goal")
        return Command(
            read_text(values, "session"), read_count(values, "seq"), read_controller(values),
            read_text(values, "clock"), read_optional(values, "renewed_s"),
            None if goal is None else _goal(as_object(goal)),
        )  # fmt: skip


class Report(NamedTuple):
    """A robot's state, sent once a period.

    Attributes:
        robot: the robot's number.
        clock: name of the clock that `stamp_s` is a time of; a new name means that it began anew, or was set back.
        stamp_s: the robot's time of this state.
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        vx_m_s: velocity, east.
        vy_m_s: velocity, north.
        yaw_rate_rad_s: counter-clockwise.
        battery: charge from 0 to 1, or None if unknown.
        gate: the gate's state.
        goal: number of the present goal, or None.
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
        """Return the report as a message."""
        return json.dumps(self._asdict() | {"gate": self.gate._asdict()}).encode()

    @staticmethod
    def decode(message: bytes) -> Report:
        """Return the report in a message.

        Raises:
            ValueError: the message holds no report; nothing else is ever raised.
        """
        return Report.read(read_object(message))

    @staticmethod
    def read(values: Mapping[str, Any]) -> Report:
        """Return a report from its fields by name, or raise ValueError; for formats other than JSON."""
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
