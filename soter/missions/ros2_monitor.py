"""Monitors robots whose AC is somebody else's node: SOTER judges, and takes a robot over only to run its SC.

Nothing here depends on ROS: the robots are already open, and reports go to a `Telling`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from soter.config import MissionFile
from soter.geometry.workspace import Workspace
from soter.rta import Request, RobotSupervisor, SwitchRecord
from soter.sdk import Controller, Fleet, Waypoint
from soter.stack.actuator import RobotActuator
from soter.stack.assembly import SafetySide, assemble

logger = logging.getLogger(__name__)

AC: Final = Controller.AC.value

_ANYWHERE: Final = Waypoint(0.0, 0.0)


class Telling(Protocol):
    """Receives the monitor's reports. Called in the thread that judges: it must not wait."""

    def tick(self, robot_id: int, driver: str, cause: str, margins: Mapping[str, float]) -> None:
        """Report that a robot was judged.

        Args:
            robot_id: the robot.
            driver: the safety module whose safe controller drives it, or "AC".
            cause: why that module drives, in words; empty for the AC.
            margins: by module, the margin at its last look, in the module's unit.
        """

    def switched(self, robot_id: int, before: str, after: str, module: str, cause: str) -> None:
        """Report that the active controller of a robot, or the module that drives it, changed.

        Args:
            robot_id: the robot.
            before: the driver before: a safety module, or "AC".
            after: the driver now.
            module: the module that caused the change.
            cause: the cause in words.
        """


class Watcher:
    """The safety side of a mission without the mission.

    Attributes:
        disengagements: by robot, how often SOTER took it over.
        late_ticks: how many ticks came later than the robots' jitter allows.

    Raises:
        IllFormedModule: a safety module cannot keep its rule on these robots; nothing has moved.
    """

    def __init__(self, mission: MissionFile, workspace: Workspace, fleet: Fleet, telling: Telling) -> None:
        self._fleet: Final = fleet
        self._telling: Final = telling
        self._tick_s: Final = mission.base_tick_s
        self._jitter_s: Final = max(robot.capabilities.jitter_s for robot in fleet.robots)
        self.disengagements: Final = {robot.id: 0 for robot in fleet.robots}
        self.late_ticks = 0
        self._safety: Final[SafetySide] = assemble(
            mission,
            workspace,
            fleet.robots,
            lambda _: None,  # nothing is requested through the ports, so that there is nothing to report
            [self],
            tap=lambda _id, actuator: _Elsewhere(actuator.robot, actuator.port),
        )

    def run(self, stop: Callable[[], bool], duration_s: float | None = None) -> None:
        """Judge at every tick until `stop` returns True, or for `duration_s` of fleet time, if given."""
        clock, supervisor, ports = self._fleet.clock, self._safety.supervisor, self._safety.ports.values()
        began_s, tick = clock.now(), 0
        while not stop() and (duration_s is None or tick * self._tick_s < duration_s):
            now_s = clock.now()
            self.late_ticks += now_s - (began_s + tick * self._tick_s) > self._jitter_s
            for port in ports:
                if port.engaged:
                    # Any goal will do: its AC drives it anywhere, and a robot with a goal is not expected to rest.
                    port.goto(_ANYWHERE)
            supervisor.tick(now_s)
            for robot in supervisor.robots.values():
                driver, cause = (AC, "") if robot.driver is None else (robot.driver.name, robot.driver.cause)
                margins = {module.name: module.margin for module in robot.modules}
                self._telling.tick(robot.robot_id, driver, cause, margins)
            tick += 1
            clock.sleep_until(began_s + tick * self._tick_s)

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Pass on a change of control; see `soter.rta.Watch`."""
        before, after = record.before or AC, record.after or AC
        self.disengagements[record.robot_id] += before == AC != after
        if before != after:
            logger.info("robot %d: %s -> %s (%s: %s)", record.robot_id, before, after, record.module, record.cause)
            self._telling.switched(record.robot_id, before, after, record.module, record.cause)


class _Elsewhere(RobotActuator):
    """A robot whose AC commands it directly: goals that SOTER would send for the AC are dropped."""

    def drive(self, command: Waypoint | Request[Waypoint] | None, mode: Controller) -> None:
        if not isinstance(command, Request):
            super().drive(command, mode)
