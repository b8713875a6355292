"""Robots that share a queue of jobs. What a robot leaves behind when its battery calls it home, another one fetches."""

from __future__ import annotations

from collections import deque
from typing import Annotated

from pydantic import Field

from soter import Mission, Robot
from soter.sdk import MAX_COORDINATE_M

Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Place = tuple[Metres, Metres]


class Delivery(Mission):
    """Whoever is free takes the next load; the mission ends when all have been delivered, or cannot be."""

    class Options(Mission.Options):
        """What `[mission]` may say.

        Attributes:
            jobs: where a load is, and where it is to be, in metres.
            loading_s: how long it takes to take a load up, or to put it down.
        """

        jobs: list[tuple[Place, Place]] = Field(min_length=1)
        loading_s: float = Field(default=2.0, ge=0.0)

    options: Options

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.waiting = deque(options.jobs)
        self.left = len(options.jobs)

    async def run(self, robot: Robot) -> None:
        while True:
            # Jobs of others may come back; who charges takes none.
            await robot.until(lambda: not self.left or (robot.engaged and bool(self.waiting)))
            if not self.left:
                return
            source, goal = self.waiting.popleft()
            ended = await self._goes(robot, source)
            if ended == "flat":
                self.waiting.appendleft((source, goal))
                continue
            if ended == "there":
                await robot.sleep(self.options.loading_s)
                ended = await self._goes(robot, goal)
                if ended == "flat" and robot.state is not None:
                    self.log(f"robot {robot.id} goes to charge and leaves its load")
                    self.waiting.appendleft(((robot.state.x_m, robot.state.y_m), goal))
                    continue
                await robot.sleep(self.options.loading_s)
            self.left -= 1
            self.log(f"robot {robot.id}, load for {goal}: {'delivered' if ended == 'there' else ended}")

    async def _goes(self, robot: Robot, place: Place) -> str:
        """Go somewhere, and again after giving way to others; return `there`, `flat`, or why it cannot be reached."""
        while True:
            arrived = await robot.go_to(*place, tries=1)
            if arrived:
                return "there"
            if arrived.module == "battery":
                return "flat"
            if arrived.module != "collision":
                return arrived.why
