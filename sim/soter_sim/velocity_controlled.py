"""The common part of simulated robots whose bases are sent velocities, over any wire."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf, isfinite
from typing import Final

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.faults import FaultPort
from soter_sim.real_time import RealTimeWorld
from soter_sim.world import World

STEP_S: Final = 1.0 / 60.0
_ODOMETRY_STEPS: Final = 2
_BATTERY_STEPS: Final = 30

START_S: Final = 1000.0
"""Initial time of robots' clocks, so that it cannot be mistaken for the host's time or for none."""

COMMAND_S: Final = 0.2
"""Time after the last velocity at which motors stop, in the world's time."""


_REST: Final = (0.0, 0.0, -COMMAND_S)


class VelocityControlledBase(ABC):
    """The base of one robot: its motors follow the last velocity, and stop when it is too old; and the robot's clock.

    Args:
        world: the robot's world.
        robot_id: its number.
    """

    def __init__(self, world: World, robot_id: int) -> None:
        self._world: Final = world
        self._index: Final = world.index(robot_id)
        self._asked = _REST
        self._began_s, self._stopped_s = 0.0, inf
        world.set_control(robot_id, self._control)

    @property
    def clock_s(self) -> float:
        """Time of the robot's own clock."""
        return START_S + min(self._world.now_s, self._stopped_s) - self._began_s

    def step_clock(self, seconds: float) -> None:
        """Set the clock forward, or back if negative."""
        self._began_s -= seconds

    def stop_clock(self) -> None:
        """Let the clock stand still from now on, while the world goes on."""
        self._stopped_s = self._world.now_s

    def restart(self) -> None:
        """Forget the last velocity, and begin the clock anew."""
        self._asked = _REST
        self._began_s, self._stopped_s = self._world.now_s, inf

    def drive(self, forward_m_s: float, turn_rad_s: float) -> None:
        """Take a velocity, from any thread; one that is not finite means rest."""
        if not isfinite(forward_m_s + turn_rad_s):
            forward_m_s = turn_rad_s = 0.0
        self._asked = forward_m_s, turn_rad_s, self._world.now_s

    @abstractmethod
    def tell_clock(self) -> None:
        """Send the time of its clock."""

    @abstractmethod
    def tell_odometry(self) -> None:
        """Send its odometry."""

    @abstractmethod
    def tell_battery(self) -> None:
        """Send its charge."""

    def _control(self, now_s: float, *_state: float) -> tuple[float, float]:
        forward_m_s, turn_rad_s, asked_s = self._asked
        return (forward_m_s, turn_rad_s) if now_s - asked_s < COMMAND_S else (0.0, 0.0)


class VelocityControlledEndpoint(RealTimeWorld):
    """A world in real time, and its robots' bases.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        limits: what the mission promises.
        truth_port: port that serves the truth; 0 for any free one.
        speedup: seconds of the world per second of the host.

    Attributes:
        bases: the robots' bases, by number, which a subclass sets.
        faults: takes faults for them.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
        truth_port: int = 0,
        speedup: float = 1.0,
    ) -> None:
        super().__init__(workspace, robots, limits, STEP_S, truth_port, speedup)
        self.bases: Final[dict[int, VelocityControlledBase]] = {}
        self.faults: Final = FaultPort(self.bases)

    def _tell(self, before: int, steps: int) -> None:
        self.faults.take()
        for base in self.bases.values():
            base.tell_clock()
        if steps // _ODOMETRY_STEPS > before // _ODOMETRY_STEPS:
            for base in self.bases.values():
                base.tell_odometry()
        if steps // _BATTERY_STEPS > before // _BATTERY_STEPS:
            for base in self.bases.values():
                base.tell_battery()

    def _end(self) -> None:
        self.faults.close()
