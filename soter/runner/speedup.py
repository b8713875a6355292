"""How much faster than the host's clock a simulated world may run before a safety module cannot keep its promise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from pydantic import BaseModel

from soter.config import Mission
from soter.errors import IllFormedModule
from soter.rta import Port, Topic
from soter.sdk import Backend, Capabilities
from soter.stack.actuator import PortForwarder
from soter.stack.declaration import Declared, PeerBounds, declare
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.terrain import Terrain
from soter.workspace import Workspace

_STEPS: Final = 20
"""Halvings of the range in which the highest speed-up is looked for; far finer than what is said of it."""


def declare_all(mission: Mission, workspace: Workspace, promised: Mapping[int, Capabilities]) -> dict[int, Declared]:
    """Declare every robot's modules without a robot.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: where.
        promised: what the robots promise, by id.

    Raises:
        IllFormedModule: a robot does not promise what the model of a module needs.
    """
    terrain = Terrain(workspace, max(each.body_radius_m for each in promised.values()))
    peers = PeerBounds.of([*promised.values()], mission.base_tick_s)
    made = {}
    for robot_id, capabilities in promised.items():
        waypoint: Topic[Any] = Topic(WAYPOINT)
        forwarder = PortForwarder(Port(robot_id, lambda _: None), waypoint, mission.base_tick_s)
        made[robot_id] = declare(
            mission, workspace, terrain, robot_id, capabilities, peers, forwarder, waypoint, RightOfWay()
        )
    return made


def highest_speedup(
    mission: Mission, workspace: Workspace, backend: type[Backend], config: BaseModel, asked: float
) -> float | None:
    """Return the highest speed-up up to `asked` at which all modules are well-formed, or None if there is none.

    Latency, age and jitter are the host's: in the time of a world that runs N times as fast they are N times as long.

    Args:
        mission: the mission.
        workspace: where.
        backend: its backend; says what robots promise at a speed-up.
        config: the backend's options.
        asked: a speed-up at which they are not.
    """
    ids = [place.id for place in workspace.robots]

    def well_formed(speedup: float) -> bool:
        promised = backend.promises(config.model_copy(update={"speedup": speedup}))
        try:
            for declared in declare_all(mission, workspace, dict.fromkeys(ids, promised)).values():
                declared.check(mission.base_tick_s)
        except IllFormedModule:
            return False
        return True

    low, high = 0.0, asked
    for _ in range(_STEPS):
        middle = (low + high) / 2.0
        if well_formed(middle):
            low = middle
        else:
            high = middle
    return low if low > 0.0 else None


def refused_at(
    failure: IllFormedModule, mission: Mission, workspace: Workspace, backend: type[Backend], config: BaseModel
) -> IllFormedModule:
    """Return the failure with the highest admissible speed-up in it, where the backend has one to choose."""
    asked = getattr(config, "speedup", None)
    if not isinstance(asked, float):
        return failure
    highest = highest_speedup(mission, workspace, backend, config, asked)
    if highest is None:
        return failure
    fits = math.floor(highest * 100.0) / 100.0
    text = str(failure).partition(": ")[2]
    return IllFormedModule(
        failure.module, failure.condition, f"{text}; or backends.{mission.backend}.speedup = {fits:g}, not {asked:g}"
    )
