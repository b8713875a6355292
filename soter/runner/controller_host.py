"""Controllers in place of the mission's machines: one for each robot, or one for all of them."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from operator import methodcaller
from pathlib import Path
from typing import Final

from soter.config import MissionFile
from soter.controllers import Arena, Controller, build
from soter.errors import account_of, is_interruption
from soter.geometry.workspace import Workspace
from soter.isolation.messages import MAX_TEXT
from soter.isolation.sandbox import denied
from soter.loading import line_in
from soter.rta import Report
from soter.runner.mission_host import MAX_INCIDENTS, Scene
from soter.runner.part import Part
from soter.runner.watchdog import CutOff
from soter.stack.site_terrain import terrain_of

logger = logging.getLogger(__name__)


@dataclass
class _Driver:
    """One controller and its robots.

    Attributes:
        controller: untrusted; called by `ControllerHost._attempt` only.
        robot_ids: its robots.
        incidents: how many of its incidents were reported already.
    """

    controller: Controller
    robot_ids: tuple[int, ...]
    incidents: int = 0

    @property
    def name(self) -> str:
        """Its name in messages."""
        return type(self.controller).__name__

    @property
    def file(self) -> Path | None:
        """Where its class is."""
        file = getattr(sys.modules.get(type(self.controller).__module__), "__file__", None)
        return Path(file) if isinstance(file, str) else None

    @property
    def whose(self) -> str:
        """Its robots, in words."""
        return f"{'robot' if len(self.robot_ids) == 1 else 'robots'} {', '.join(map(str, self.robot_ids))}"

    @property
    def acts(self) -> str:
        """The name in messages of the method that runs at a tick."""
        return "step" if type(self.controller).act is Controller.act else "act"


class ControllerHost:
    """A `MissionHost` that runs controllers. No planner, no machines, no targets.

    A controller that fails costs its own robots their AC, and nothing else.

    Args:
        mission: its `ac` names the controller.
        workspace: fence, boxes, chargers.
        part: this process's part of the mission; None for all of it. Only its robots are driven, but all are seen.

    Raises:
        ConfigError: there is no such controller, or it does not allow an option.
    """

    paths_replaced = 0
    done = False
    sandbox = None
    answers = None
    not_begun = ""

    def __init__(self, mission: MissionFile, workspace: Workspace, part: Part | None = None) -> None:
        self._mission: Final = mission
        everybody = [place.id for place in workspace.robots]
        own = everybody if part is None else part.robots
        made = build(mission, own, {*everybody}.difference(own))
        self._drivers: Final = [_Driver(controller, robot_ids) for robot_ids, controller in made.items()]
        self._driver_of: Final = {robot_id: driver for driver in self._drivers for robot_id in driver.robot_ids}
        self._tick = 0
        self.failures: dict[int | None, str] = {}
        self.incidents: list[str] = []
        self.current_handler: str | None = None

    def ready(self) -> None:
        """Return at once: nothing runs in another process."""

    def receive(self) -> None:
        """Do nothing: nothing runs in another process."""

    def start(self, scene: Scene) -> None:
        """Give every controller its ports."""
        mission = self._mission
        for driver in self._drivers:
            ids = driver.robot_ids
            # A controller of a fleet is given one body radius, the largest.
            radius_m = max(scene.rooms[each].terrain.body_radius_m for each in ids)
            arena = Arena(
                terrain_of(scene.workspace, radius_m), {each: scene.ports[each] for each in ids},
                {**scene.ports, **scene.peers}, {each: scene.capabilities[each] for each in ids}, mission.rta,
                mission.base_tick_s, mission.seed,
            )  # fmt: skip
            self._attempt(driver, "begin", methodcaller("begin", arena))

    def hear(self, report: Report) -> None:
        """Pass on a port's report."""
        driver = self._driver_of[report.robot_id]
        self._attempt(driver, "hear", methodcaller("hear", report))

    def run(self, now_s: float) -> None:
        """Let every controller act."""
        tick, self._tick = self._tick, self._tick + 1
        for driver in self._drivers:
            self._attempt(driver, driver.acts, partial(self._act, driver, now_s, tick))

    def close(self) -> None:
        """Close the controllers."""
        for driver in self._drivers:
            self.current_handler = f"{driver.name}.close"
            try:
                driver.controller.close()
            except CutOff as failure:
                logger.error("%s", failure)
            except KeyboardInterrupt:
                raise
            except BaseException as failure:  # noqa: BLE001 - it is untrusted, and the run is over
                logger.warning("%s: %s could not be closed: %s", driver.whose, driver.name, account_of(failure))

    def _act(self, driver: _Driver, now_s: float, tick: int, controller: Controller) -> None:
        controller.act(now_s, tick)
        found = [*islice(controller.incidents[driver.incidents :], MAX_INCIDENTS - len(self.incidents))]
        self.incidents += [str.encode(each, errors="backslashreplace").decode()[:MAX_TEXT] for each in found]
        driver.incidents += len(found)

    def _attempt(self, driver: _Driver, handler: str, call: Callable[[Controller], object]) -> None:
        """Call a controller, unless it has failed already."""
        if driver.robot_ids[0] in self.failures:
            return
        self.current_handler = f"{driver.name}.{handler}"
        try:
            call(driver.controller)
        except BaseException as failure:
            if is_interruption(failure):
                raise
            cause = f"{driver.name} failed: {account_of(failure)}{line_in(driver.file, failure)}"
            cause += _not_begun(driver.controller, failure) or denied(failure)
            logger.error("%s: %s", driver.whose, cause)
            self.failures.update(dict.fromkeys(driver.robot_ids, cause))
        finally:
            self.current_handler = None


def _not_begun(controller: Controller, failure: BaseException) -> str:
    """Return, as the end of a message, that a failure comes of a `begin` that does not call its base's; else empty."""
    begin = type(controller).begin
    if type(failure) is not AttributeError or failure.obj is not controller or begin is Controller.begin:
        return ""
    if failure.name not in ("arena", "random"):
        return ""
    code = getattr(begin, "__code__", None)
    place = f" ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code is not None else ""
    return f"; its `begin`{place} has to call super().begin(arena), which sets it"
