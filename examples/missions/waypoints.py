"""Robots that visit the places of a list, one after the other, each beginning with another one."""

from __future__ import annotations

from pydantic import Field

from soter import Mission, Robot


class Waypoints(Mission):
    """Every robot visits all of them, as often as it is told to; a place that it cannot reach is left out."""

    class Options(Mission.Options):
        """What `[mission]` may say.

        Attributes:
            points: metres, x and y.
            rounds: how often.
            timeout_s: time for each, in which the robot is free to drive.
        """

        points: list[tuple[float, float]] = Field(min_length=1)
        rounds: int = Field(default=1, ge=1)
        timeout_s: float = Field(default=60.0, gt=0.0)

    options: Options

    async def run(self, robot: Robot) -> None:
        points = self.options.points
        first = robot.id - 1
        for number in range(first, first + self.options.rounds * len(points)):
            point = points[number % len(points)]
            arrived = await robot.go_to(*point, timeout_s=self.options.timeout_s)
            if not arrived:
                self.log(f"robot {robot.id}, {point}: {arrived.why}")
        self.log(f"robot {robot.id} is done after {robot.now():.0f} s")
