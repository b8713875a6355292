"""What goes over the wire, for both its ends: JSON in the robots' own frame, which is not SOTER's.

The robots think like surveyors: north and east in metres, headings in degrees clockwise from north, charge in per
cent. Everything here turns that into SOTER's frame or back; nothing else does.
"""

from __future__ import annotations

import json
import math

from soter.onboard.command import Command, GoalMessage, Report
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


def encode_command(command: Command) -> bytes:
    """Return what the robot is to do, as it reads it."""
    goal = command.goal
    return json.dumps({
        "session": command.session, "seq": command.seq, "boot": command.clock, "lease_s": command.renewed_s,
        "controller": command.controller,
        "goal": goal and {
            "id": goal.id, "by": goal.by, "north_m": goal.y_m, "east_m": goal.x_m,
            "heading_deg": None if goal.heading_rad is None else compass_deg(goal.heading_rad),
            "speed_m_s": goal.speed_m_s,
        },
    }).encode()  # fmt: skip


def decode_command(message: bytes) -> Command:
    """Read what the robot is to do.

    Raises:
        ValueError: it is no command, or a number in it is none.
    """
    values = read_object(message)
    goal = None
    if values.get("goal") is not None:
        told = as_object(values["goal"])
        degrees = read_optional(told, "heading_deg")
        goal = GoalMessage(
            read_count(told, "id"), read_controller(told, "by"), read_number(told, "east_m"),
            read_number(told, "north_m"), 0.0, None if degrees is None else heading_rad(degrees),
            read_optional(told, "speed_m_s"),
        )  # fmt: skip
    return Command(
        read_text(values, "session"), read_count(values, "seq"), read_controller(values),
        read_text(values, "boot"), read_optional(values, "lease_s"), goal,
    )  # fmt: skip


def encode_report(report: Report) -> bytes:
    """Return how a robot is, as it says it."""
    return json.dumps({
        "robot": report.robot, "boot": report.clock, "stamp_s": report.stamp_s, **report.gate._asdict(),
        "north_m": report.y_m, "east_m": report.x_m, "heading_deg": compass_deg(report.heading_rad),
        "north_m_s": report.vy_m_s, "east_m_s": report.vx_m_s, "turn_deg_s": -math.degrees(report.yaw_rate_rad_s),
        "charge_percent": report.battery and 100.0 * report.battery, "goal": report.goal,
    }).encode()  # fmt: skip


def decode_report(message: bytes) -> Report:
    """Read how a robot is.

    Raises:
        ValueError: it is no report, or a number in it is none.
    """
    values = read_object(message)
    return Report(
        robot=read_count(values, "robot"),
        clock=read_text(values, "boot"),
        stamp_s=read_number(values, "stamp_s"),
        x_m=read_number(values, "east_m"),
        y_m=read_number(values, "north_m"),
        heading_rad=heading_rad(read_number(values, "heading_deg")),
        vx_m_s=read_number(values, "east_m_s"),
        vy_m_s=read_number(values, "north_m_s"),
        yaw_rate_rad_s=-math.radians(read_number(values, "turn_deg_s")),
        battery=read_number(values, "charge_percent") / 100.0,
        gate=GateReport.read(values),
        goal=None if values.get("goal") is None else read_count(values, "goal"),
    )


def compass_deg(heading_rad: float) -> float:
    """Return a heading counter-clockwise from east, in radians, as degrees clockwise from north in [0, 360)."""
    return (90.0 - math.degrees(heading_rad)) % 360.0


def heading_rad(compass_deg: float) -> float:
    """Return a heading in degrees clockwise from north as radians counter-clockwise from east in (-pi, pi]."""
    angle_rad = math.radians(90.0 - compass_deg)
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)
