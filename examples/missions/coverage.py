"""Robots that sweep all free ground between them, as one mows a lawn."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pydantic import Field

from soter import Mission, Robot

Place = tuple[float, float]

_STEP_M = 0.05


class Coverage(Mission):
    """The ground is cut into lanes from west to east; whoever is free sweeps the one that begins nearest to it."""

    class Options(Mission.Options):
        """What `[mission]` may say.

        Attributes:
            lane_m: distance between two lanes.
            margin_m: distance that a body keeps from fence and boxes.
        """

        lane_m: float = Field(default=0.5, ge=0.1)
        margin_m: float = Field(default=0.25, ge=0.0, le=100.0)

    options: Options
    lanes: list[tuple[Place, Place]] | None = None
    surveyed = False

    async def run(self, robot: Robot) -> None:
        if self.lanes is None:
            self.lanes = []
            # A row a tick: a script that looks at a large site all at once would block the mission.
            for lanes_of_row in self._rows(robot):
                self.lanes += lanes_of_row
                await robot.sleep(0.0)
            self.surveyed = True
        lanes, swept = self.lanes, 0
        await robot.until(lambda: self.surveyed and robot.state is not None)
        while lanes and (state := robot.state) is not None:
            here = (state.x_m, state.y_m)
            lane = min(lanes, key=lambda ends: min(math.dist(here, end) for end in ends))
            lanes.remove(lane)
            for end in sorted(lane, key=lambda place: math.dist(here, place)):
                arrived = await robot.go_to(*end)
                if not arrived:
                    self.log(f"robot {robot.id}, lane at y = {end[1]:g}: {arrived.why}")
            swept += 1
        self.log(f"robot {robot.id} has swept {swept} lanes")

    def _rows(self, robot: Robot) -> Iterator[list[tuple[Place, Place]]]:
        """Yield by row, from south to north, both ends of every lane that is free all along."""
        room, inset_m = robot.workspace, self.options.margin_m + robot.body_radius_m
        low_x, low_y, high_x, high_y = room.bounds
        for row in range(math.floor((high_y - low_y - 2.0 * inset_m) / self.options.lane_m) + 1):
            y, begin, last = low_y + inset_m + row * self.options.lane_m, None, 0.0
            lanes: list[tuple[Place, Place]] = []
            columns = math.floor((high_x - low_x - 2.0 * inset_m) / _STEP_M) + 1
            for x in [low_x + inset_m + column * _STEP_M for column in range(columns)] + [math.inf]:
                # Rounding must not cost the lanes right beside the fence.
                if math.isfinite(x) and min(room.fence_m(x, y), room.clearance_m(x, y, 0.0)) >= inset_m - 1e-9:
                    begin = x if begin is None else begin
                    last = x
                elif begin is not None:
                    lanes.append(((begin, y), (last, y)))
                    begin = None
            yield lanes
