"""Makes the ACs' side that a mission asks for."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Final

from soter.config import Mission
from soter.rta import Report
from soter.runner.ac_side import AcSide, Scene
from soter.runner.mission_side import MissionSide
from soter.runner.part import Part
from soter.stack.adversaries import MISSION, Arena, build_adversary
from soter.workspace import Workspace

logger = logging.getLogger(__name__)


class AdversarySide:
    """An `AcSide` with an adversary behind it. No planner, no machines, no targets.

    Args:
        mission: its `ac` names the adversary.

    Raises:
        ConfigError: no such adversary, or options that it does not allow.
    """

    paths_replaced = 0

    def __init__(self, mission: Mission) -> None:
        self._mission: Final = mission
        self._adversary: Final = build_adversary(mission)
        self._name: Final = type(self._adversary).__name__
        self._robot_ids: tuple[int, ...] = ()
        self._tick = 0
        self.failures: dict[int | None, str] = {}
        self.current_handler: str | None = None

    def ready(self) -> None:
        """Nothing runs elsewhere."""

    def start(self, scene: Scene) -> None:
        """Give the adversary its ports."""
        mission = self._mission
        arena = Arena(scene.terrain, scene.ports, mission.rta, mission.base_tick_s, mission.seed)
        self._robot_ids = tuple(scene.ports)
        try:
            self._adversary.begin(arena)
        except Exception as failure:  # noqa: BLE001 - as below
            self._failed(failure)

    def hear(self, report: Report) -> None:
        """Pass on what a port reports."""
        if not self.failures:
            try:
                self._adversary.hear(report)
            except Exception as failure:  # noqa: BLE001 - it is untrusted, and this is the supervisor's thread
                self._failed(failure)

    def run(self, now_s: float) -> None:
        """Let the adversary act."""
        tick, self._tick = self._tick, self._tick + 1
        if self.failures:
            return
        self.current_handler = f"{self._name}.act"
        try:
            self._adversary.act(now_s, tick)
        except Exception as failure:  # noqa: BLE001 - an AC that fails costs its robots their AC, and nothing else
            self._failed(failure)
        finally:
            self.current_handler = None

    @property
    def incidents(self) -> Sequence[str]:
        """What makes this run one that does not repeat."""
        return self._adversary.incidents

    def close(self) -> None:
        """End what the adversary started."""
        self._adversary.close()

    def _failed(self, failure: Exception) -> None:
        logger.error("the adversary failed: %r", failure)
        # By robot: the run goes on, and what becomes of robots without an AC is part of what it shows.
        self.failures.update(dict.fromkeys(self._robot_ids, f"{self._name} failed: {failure!r}"))


def make_ac_side(
    mission: Mission, workspace: Workspace, body_radius_m: float, *, virtual_time: bool, process: str | None = None
) -> AcSide:
    """Return the ACs' side of a mission, not yet begun.

    Args:
        mission: its `ac` says who the ACs are.
        workspace: where.
        body_radius_m: of the robots.
        virtual_time: time does not pass by itself, so that what is worked out may not depend on the host.
        process: which process of a distributed mission this is; None for a mission in one process.

    Raises:
        ConfigError: no such AC, or options that it does not allow; nothing has moved.
        BackendError: what joins the processes cannot be opened.
    """
    if process is not None:
        part = Part.of(mission, workspace, process)
        return MissionSide(
            mission, workspace, body_radius_m, virtual_time=virtual_time, part=part, bus=part.open_bus()
        )  # fmt: skip
    if mission.ac != MISSION:
        return AdversarySide(mission)
    return MissionSide(mission, workspace, body_radius_m, virtual_time=virtual_time)
