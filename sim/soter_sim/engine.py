"""The interface of a world's engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final, Protocol

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import Bodies
from soter_sim.truth import Record

MOST_BOXES: Final = 10_000
"""Most boxes that a map may be made of in a world of rigid bodies."""


@lru_cache(maxsize=2)
def boxes_of_map(workspace: Workspace) -> int:
    """Return how many boxes the occupied cells of a workspace's map are made of; 0 without a map."""
    from soter.geometry.site import Site  # here: most programs have no map, and need no library for arrays

    grid = workspace.plan.map if isinstance(workspace, Site) else None
    return 0 if grid is None else len(grid.rings())


class Engine(Protocol):
    """Moves bodies in control periods of fixed length.

    Attributes:
        bodies: the robots, as they are after the periods run so far.
        period_s: the control period, in seconds.
        record: what really happened.
    """

    bodies: Bodies
    period_s: float
    record: Record

    def run(self, until_period: int) -> None:
        """Run until this many periods have passed since the start; do nothing if they have already.

        At the beginning of each period every robot's control is called, in order.
        """

    def velocity(self, index: int) -> tuple[float, float]:
        """Return a robot's velocity east and north in m/s."""

    def close(self) -> None:
        """Free what the engine holds. Idempotent; it cannot run afterwards."""


EngineFactory = Callable[[Workspace, Sequence[RobotSpec], RuleLimits], Engine]
"""Makes the engine of a world; the limits are those that the world is judged by."""
