"""A mission in which robots visit the places of a list in turn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import Field, model_validator

from soter.errors import ConfigError
from soter.geometry.workspace import Workspace
from soter.missions.mission import Mission
from soter.missions.script import LONGEST_S, Robot
from soter.sdk import MAX_COORDINATE_M

Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Places = list[tuple[Metres, Metres]]


class Waypoints(Mission):
    """Every robot visits all places, for a number of rounds; a place that it cannot reach is skipped."""

    class Options(Mission.Options):
        """The options in `[mission]`.

        Attributes:
            points: x and y in metres; each robot begins with another point.
            robots: by robot, the points that it visits instead, from the first to the last.
            rounds: how often all points are visited.
            timeout_s: time for each point, with the AC in control.
        """

        points: Places = Field(default=[])
        robots: dict[str, Places] = Field(default={})
        rounds: int = Field(default=1, ge=1)
        timeout_s: float = Field(default=60.0, gt=0.0, le=LONGEST_S)

        @model_validator(mode="after")
        def _has_some(self) -> Self:
            if not self.points and not any(self.robots.values()):
                raise ValueError("there is nowhere to go; give points, or robots.N")
            return self

    options: Options

    @classmethod
    def check_workspace(cls, options: Options, workspace: Workspace, body_radius_m: Mapping[int, float]) -> None:
        """Refuse points for robots that are not in the workspace."""
        ids = [str(place.id) for place in workspace.robots]
        for name in options.robots:
            if name not in ids:
                raise ConfigError(f"there is no robot '{name}'; allowed: {', '.join(ids)}", key="mission.robots")

    async def run(self, robot: Robot) -> None:
        options = self.options
        own = options.robots.get(str(robot.id))
        first = robot.id - 1 if own is None else 0
        points = options.points if own is None else own
        for number in range(first, first + options.rounds * len(points)):
            point = points[number % len(points)]
            arrived = await robot.go_to(*point, timeout_s=options.timeout_s)
            if not arrived:
                self.log(f"robot {robot.id}, {point}: {arrived.why}")
        self.log(f"robot {robot.id} is done after {robot.now():.0f} s")
