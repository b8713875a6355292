"""The backend `zenoh`: robots on keys, those that are given or simulated ones that are started for the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import ClassVar

from soter.adapters.zenoh.options import RobotOptions, ZenohConfig
from soter.adapters.zenoh.robot import ZenohRobot
from soter.adapters.zenoh.session import close_session, open_session
from soter.adapters.zenoh.simulator import Simulator
from soter.clock import VehicleClock
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Capabilities, Robot, RobotSpec
from soter.streamed.options import require_places
from soter.streamed.simulator import StreamedFleet


class ZenohFleet(StreamedFleet[ZenohRobot, Simulator]):
    """Robots, the session that they are heard over, and the simulator if it was started for them.

    Args:
        config: where the robots are.
        specs: the robots.
        simulator: a simulator to end with the fleet, or None.
    """

    def __init__(self, config: ZenohConfig, specs: Sequence[RobotSpec], simulator: Simulator | None) -> None:
        clock = VehicleClock(rate=config.speedup)
        robot_class = promising(config.promised())

        def make(stack: ExitStack) -> Sequence[ZenohRobot]:
            session = open_session(config.session)
            stack.callback(close_session, session)
            return [robot_class(spec, clock, session, config) for spec in specs]

        super().__init__(clock, config.truth, simulator, make)


class ZenohBackend(Backend):
    """Robots on keys: those that are given, or simulated ones that are started for the occasion."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = ZenohConfig
    robot_class: ClassVar[type[Robot]] = ZenohRobot
    harness: ClassVar[str] = "soter.adapters.zenoh.harness:ZenohHarness"

    @classmethod
    def promises(cls, config: ZenohConfig) -> Capabilities:
        return config.promised()

    def open(self, config: ZenohConfig, robots: Sequence[RobotSpec]) -> ZenohFleet:
        """Open the robots; they are not ready before `init()`.

        Raises:
            RobotUnavailable: a robot is not given, or the simulated ones do not start.
        """
        if config.robots:
            require_places(config.robots, robots, "backends.zenoh.robots")
            return ZenohFleet(config, robots, None)
        simulator = Simulator(
            config.workspace, robots, config.session,
            stamped=config.stamped, speedup=config.speedup, private=True, limits=config.limits,
        )  # fmt: skip
        try:
            return ZenohFleet(simulated(config, simulator), robots, simulator)
        except BaseException:
            simulator.close()
            raise


def promising(promised: Capabilities) -> type[ZenohRobot]:
    """Return a class of robots that declare this much."""
    if promised == ZenohRobot.declared:
        return ZenohRobot

    class Promising(ZenohRobot):
        """A robot with the promises of the configuration."""

        declared: ClassVar[Capabilities] = promised

    return Promising


def simulated(config: ZenohConfig, simulator: Simulator) -> ZenohConfig:
    """Return a configuration with the robots of a simulator in it."""
    robots = {robot_id: RobotOptions(namespace=name) for robot_id, name in simulator.namespaces.items()}
    return config.model_copy(update={"robots": robots, "session": simulator.session, "truth": simulator.truth})
