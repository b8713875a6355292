"""A process with the task planner and no robots: it gives targets, and counts how they end. No safety rests on it."""

from __future__ import annotations

import logging
import math
import time
from contextlib import ExitStack
from typing import Final

from soter.clock import Clock, VehicleClock
from soter.errors import RunFailed
from soter.geometry.workspace import Workspace
from soter.runner.ac_side import Scene
from soter.runner.metrics import Metrics, counts
from soter.runner.mission_side import MissionSide
from soter.runner.part import Part
from soter.runner.progress import Audience, Progress
from soter.runner.remote_side import WALL_CLOCK
from soter.runner.result import Run, RunResult
from soter.runner.together import Said, Together
from soter.runner.watchdog import HandlerWatchdog

logger = logging.getLogger(__name__)


def run_planner(
    part: Part,
    workspace: Workspace,
    audience: Audience,
    say: Said,
) -> Run:
    """Run a task planner whose robots are all in other processes; see `soter.runner.run.run_mission`.

    Raises:
        ConfigError: bad input.
        BackendError: the others cannot be reached, or do not come.
    """
    clock = VehicleClock()
    with ExitStack() as stack:
        together = stack.enter_context(Together(part, clock))
        radii_m = {robot_id: each.body_radius_m for robot_id, each in part.promised.items()}
        side = MissionSide(
            part.mission, workspace, radii_m, virtual_time=False, part=part, bus=part.open_bus()
        )  # fmt: skip
        stack.callback(side.close)
        loop = _PlannerLoop(part, workspace, side, together, clock)
        return loop.run(audience, say)


class _PlannerLoop:
    """One run, from the first tick to the last."""

    def __init__(
        self,
        part: Part,
        workspace: Workspace,
        side: MissionSide,
        together: Together,
        clock: Clock,
    ) -> None:
        self.part: Final = part
        self.mission: Final = part.mission
        self.side: Final = side
        self.together: Final = together
        self.clock: Final[Clock] = clock
        self.workspace: Final = workspace
        self.modules: Final = self.mission.rta.order
        self.metrics: Final = Metrics(workspace, self.modules, sorted(part.homes), None)
        self.ticks = 0
        self.wall_s = 0.0

    def run(self, audience: Audience, say: Said) -> Run:
        """Wait for the others, then tick until the time is up."""
        start_s = time.perf_counter()
        status, failure = "interrupted", ""
        try:
            if self.together.wait((), say, audience.stop):
                self._begin()
                start_s = time.perf_counter()
                with HandlerWatchdog(lambda: self.side.current_handler, lambda: self.ticks) as watchdog:
                    status = self._tick_on(watchdog, start_s, audience)
        except KeyboardInterrupt:
            status = "interrupted"
        except RunFailed as failed:
            logger.error("the run failed: %s", failed)
            status, failure = "failed", str(failed)
        self.wall_s = time.perf_counter() - start_s
        self.metrics.finish(self.ticks * self.mission.base_tick_s)
        return Run(self._result(status, failure), self.metrics.tracks)

    def _begin(self) -> None:
        self.side.start(Scene(self.clock, self.workspace, {}, {}, self.metrics, peers=self.together.ports))

    def _tick_on(self, watchdog: HandlerWatchdog, start_s: float, audience: Audience) -> str:
        base_tick_s, clock, together = self.mission.base_tick_s, self.clock, self.together
        began_s, shown_s = clock.now(), -math.inf
        self.metrics.begin(began_s)
        for tick in range(round(self.mission.duration_s / base_tick_s)):
            now_s = clock.now()
            together.look()
            together.tell(())
            self.side.run(now_s)
            watchdog.check()
            if self.side.failures:
                raise RunFailed(next(iter(self.side.failures.values())))
            self.metrics.tick(now_s, tick, now_s - (began_s + tick * base_tick_s), (), lambda _: False)
            self.ticks = tick + 1
            wall_s = time.perf_counter()
            if audience.show is not None and wall_s - shown_s >= audience.every_s:
                shown_s = wall_s
                audience.show(self._progress(wall_s - start_s))
            clock.sleep_until(began_s + (tick + 1) * base_tick_s)
            if audience.stop():
                return "interrupted"
        return "completed"

    def _progress(self, wall_s: float) -> Progress:
        reached = self.metrics.reached_by_robot
        robots = tuple(each._replace(targets_reached=reached[each.robot_id]) for each in self.together.progress())
        return Progress(self.ticks * self.mission.base_tick_s, self.mission.duration_s, wall_s, robots, None)

    def _result(self, status: str, failure: str) -> RunResult:
        """Sum up; what only processes with robots can know is not counted here."""
        mission, metrics = self.mission, self.metrics
        duration_s, targets = round(self.ticks * mission.base_tick_s, 6), metrics.target_counts()
        return RunResult(
            status=status,
            failure=failure,
            mission=mission.source or "",
            process=self.part.name,
            peer_age_ms=self.together.ages_ms(),
            peer_tick_us=self.together.took_us(),
            backend=mission.backend,
            planner=mission.planner,
            ac=mission.ac,
            does=mission.mission.use,
            targets_from=mission.targets_from,
            modules=self.modules,
            robots=0,
            seed=mission.seed,
            duration_s=duration_s,
            wall_s=round(self.wall_s, 3),
            real_time_factor=round(duration_s / self.wall_s, 1) if self.wall_s else 0.0,
            disengagements=counts({}, self.modules),
            joined=counts({}, self.modules),
            targets=targets,
            targets_reached=targets.reached,
            no_progress_s=round(metrics.no_progress_s, 2),
            dm_tick_us=metrics.tick_times(),
            tick_late_ms=metrics.tick_lateness(),
            deterministic=False,
            nondeterminism=WALL_CLOCK,
        )
