"""Records of changes of control, and the interface of those who watch them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from soter.rta.supervisor import RobotSupervisor

SUPERVISOR = "supervisor"
"""Stands in place of a module's name when a failed assumption, not a margin, caused a disengagement."""


class SwitchRecord(NamedTuple):
    """One change of control of a robot, or of the module that drives.

    Attributes:
        time_s: fleet time.
        robot_id: which robot.
        before: module that drove, or None for the AC.
        after: module that drives now, or None for the AC.
        module: the module that caused the change: the first that fired, or the last that released.
        cause: in words.
        joined: further modules that fired in the same tick.
    """

    time_s: float
    robot_id: int
    before: str | None
    after: str | None
    module: str
    cause: str
    joined: tuple[str, ...]


class Watch(Protocol):
    """An observer that is called at every switch; it may not change anything."""

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Take note of a change of control; called before the new driver's first command."""
