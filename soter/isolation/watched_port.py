"""The port of a robot that is commanded elsewhere."""

from __future__ import annotations

from soter.rta import Port, Request
from soter.sdk import RobotState, Waypoint


class WatchedPort(Port[Waypoint, RobotState]):
    """Shows where a robot is and whether its AC has control, and takes no commands."""

    def __init__(self, robot_id: int) -> None:
        super().__init__(robot_id, lambda report: None)  # nobody can ask for anything

    def put(self, request: Request[Waypoint]) -> None:
        """Leave it out: who commands this robot is elsewhere."""

    def goto(self, command: Waypoint, upcoming: tuple[Waypoint, ...] = ()) -> int:
        """Leave it out, and return 0, which is no goal's number."""
        return 0
