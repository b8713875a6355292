"""The port of a robot that another process commands."""

from __future__ import annotations

from soter.rta import Port, Request
from soter.sdk import RobotState, Waypoint


class WatchedPort(Port[Waypoint, RobotState]):
    """Shows a robot's state and whether its AC is active, and takes no commands."""

    def __init__(self, robot_id: int) -> None:
        super().__init__(robot_id, lambda report: None)  # there are no requests to report on

    def put(self, request: Request[Waypoint]) -> None:
        """Do nothing: another process commands this robot."""

    def goto(self, command: Waypoint, upcoming: tuple[Waypoint, ...] = ()) -> int:
        """Do nothing, and return 0, which is no goal's number."""
        return 0
