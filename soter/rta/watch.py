"""Changes of control, and who is told of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from soter.rta.supervisor import RobotSupervisor

SUPERVISOR = "supervisor"
"""Named as the module when a disengagement comes from an assumption that failed, not from a module's margin."""


class SwitchRecord(NamedTuple):
    """One change of control of a robot, or of the module that drives.

    Attributes:
        time_s: fleet time.
        robot_id: which robot.
        before: module that drove, or None for the AC.
        after: module that drives now, or None for the AC.
        module: the one that caused the change: the first that fired, or the last that released.
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
    """Somebody who is told of every switch; may not change anything."""

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Called when a robot changed hands, before its new driver's first command."""
