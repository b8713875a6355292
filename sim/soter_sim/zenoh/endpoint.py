"""A world in real time as robots on keys."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import zenoh

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.velocity_controlled import VelocityControlledEndpoint
from soter_sim.zenoh.base import Base


class Endpoint(VelocityControlledEndpoint):
    """The Zenoh endpoint of a world.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        namespaces: by robot, the prefix of its keys.
        session: the Zenoh session to use, which the caller closes.
        limits: what the mission promises.
        stamped: whether velocities come as TwistStamped.
        truth_port: port that serves the truth; 0 for any free one.
        speedup: seconds of the world per second of the host.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        namespaces: Mapping[int, str],
        session: zenoh.Session,
        limits: RuleLimits,
        *,
        stamped: bool = False,
        truth_port: int = 0,
        speedup: float = 1.0,
    ) -> None:
        super().__init__(workspace, robots, limits, truth_port, speedup)
        for robot in robots:
            self.bases[robot.id] = Base(session, namespaces[robot.id], self.world, robot.id, stamped=stamped)

    def _wait(self, seconds: float) -> None:
        time.sleep(seconds)
