"""The backends `pybullet` and `kinematic`: one adapter over two engines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from soter.adapters.pybullet.robot import KinematicRobot, SimulatedRobot
from soter.clock import VirtualClock
from soter.errors import BackendUnavailable, RobotUnavailable
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Fleet, RobotSpec
from soter.sdk.hints import install_command
from soter_sim import World


class PyBulletConfig(BackendConfig):
    """Options of the backend `pybullet`.

    Attributes:
        engine: what moves the robots: rigid bodies, or the closed-form model of the backend `kinematic`.
    """

    engine: Literal["pybullet", "kinematic"] = "pybullet"


class KinematicConfig(BackendConfig):
    """The backend `kinematic` has no options of its own.

    Attributes:
        engine: fixed.
    """

    engine: Literal["kinematic"] = "kinematic"


class SimulatedFleet(Fleet):
    """Robots of one world; sleeping on the fleet's clock moves it.

    Args:
        world: the world.
        specs: its robots.
        robot_class: what they are here.

    Attributes:
        world: for whoever records or shows the world; robots are commanded through the interface.
    """

    def __init__(
        self, world: World, specs: Sequence[RobotSpec], robot_class: type[SimulatedRobot] = SimulatedRobot
    ) -> None:
        clock = VirtualClock(world.advance)
        super().__init__(clock, [robot_class(spec, clock, world) for spec in specs], world.truth)
        self.world = world

    def _close(self) -> None:
        self.world.close()


class PyBulletBackend(Backend):
    """Robots in a PyBullet world in this process, in virtual time."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = PyBulletConfig
    robot_class: ClassVar[type[SimulatedRobot]] = SimulatedRobot

    def open(self, config: PyBulletConfig | KinematicConfig, robots: Sequence[RobotSpec]) -> SimulatedFleet:
        """Build the world and put the robots into it.

        Raises:
            RobotUnavailable: the robots cannot be put there; the message says why.
            BackendUnavailable: PyBullet is not installed.
        """
        try:
            world = World(config.workspace, robots, config.engine, config.limits)
        except ImportError as missing:
            raise BackendUnavailable(
                f"the engine '{config.engine}' needs PyBullet: {missing}; run: {install_command('pybullet')}; "
                "the engine 'kinematic' needs nothing"
            ) from missing
        except ValueError as failure:
            raise RobotUnavailable(str(failure)) from failure
        return SimulatedFleet(world, robots, self.robot_class)


class KinematicBackend(PyBulletBackend):
    """The same robots moved in closed form: no physics, and many times faster."""

    config_model: ClassVar[type[BackendConfig]] = KinematicConfig
    robot_class: ClassVar[type[SimulatedRobot]] = KinematicRobot
