"""What goes over the wire, for both its ends: the types of `messages.lcm`, and the channels of a robot."""

from __future__ import annotations

import struct
from typing import TypeVar

from soter.onboard.command import Command, Report
from soter_lcm.types import command_t, goal_t, report_t

T = TypeVar("T", command_t, report_t)


def command_channel(robot_id: int) -> str:
    """Return where a robot hears what it is to do."""
    return f"robot{robot_id}/command"


def report_channel(robot_id: int) -> str:
    """Return where a robot says how it is."""
    return f"robot{robot_id}/report"


def encode_command(command: Command) -> bytes:
    """Return what the robot is to do."""
    said = command_t()
    said.session, said.seq, said.controller, said.clock = command[:4]
    said.renewed, said.renewed_s = command.renewed_s is not None, command.renewed_s or 0.0
    # A goal without content must be of the right types, too.
    said.going, said.goal = command.goal is not None, goal_t()
    if command.goal is not None:
        goal = said.goal
        goal.id, goal.by, goal.x_m, goal.y_m = command.goal[:4]
        goal.turned, goal.heading_rad = command.goal.heading_rad is not None, command.goal.heading_rad or 0.0
        goal.speed_m_s = command.goal.speed_m_s or 0.0
    return bytes(said.encode())


def decode_command(message: bytes) -> Command:
    """Read what the robot is to do.

    Raises:
        ValueError: it is no command, or a number in it is none.
    """
    said = _decoded(command_t, message)
    goal = said.goal
    return Command.read({
        "session": said.session, "seq": said.seq, "controller": said.controller, "clock": said.clock,
        "renewed_s": said.renewed_s if said.renewed else None,
        "goal": {
            "id": goal.id, "by": goal.by, "x_m": goal.x_m, "y_m": goal.y_m, "z_m": 0.0,
            "heading_rad": goal.heading_rad if goal.turned else None, "speed_m_s": goal.speed_m_s or None,
        } if said.going else None,
    })  # fmt: skip


def encode_report(report: Report) -> bytes:
    """Return how a robot is."""
    said = report_t()
    said.robot, said.clock, said.stamp_s, said.x_m, said.y_m, said.heading_rad = report[:6]
    said.vx_m_s, said.vy_m_s, said.yaw_rate_rad_s, said.charge = (*report[6:9], report.battery or 0.0)
    said.session, said.seq, said.controller, said.alive = report.gate
    said.goal = report.goal or 0
    return bytes(said.encode())


def decode_report(message: bytes) -> Report:
    """Read how a robot is.

    Raises:
        ValueError: it is no report, or a number in it is none.
    """
    said = _decoded(report_t, message)
    values = {name: getattr(said, name) for name in said.__slots__}
    return Report.read({**values, "battery": said.charge, "gate": values, "goal": said.goal or None, "z_m": 0.0})


def _decoded(kind: type[T], message: bytes) -> T:
    try:
        decoded: T = kind.decode(message)
    except struct.error as failure:
        # What LCM's generated code raises where a message ends too soon.
        raise ValueError(f"no {kind.__name__}: {failure}") from failure
    return decoded
