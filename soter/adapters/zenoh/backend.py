"""The backend `zenoh`: robots on keys, those that are given or simulated ones that are started for the run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from soter.adapters.zenoh.options import RobotOptions, ZenohConfig
from soter.adapters.zenoh.robot import ZenohRobot
from soter.adapters.zenoh.session import close_session, open_session
from soter.adapters.zenoh.simulator import Simulator
from soter.clock import VehicleClock
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Capabilities, Fleet, Robot, RobotSpec
from soter.sdk.truth import StreamedTruth
from soter.streamed.options import require_places


class ZenohFleet(Fleet):
    """Robots, the session that they are heard over, and the simulator if it was started for them.

    Args:
        config: where the robots are.
        specs: the robots.
        simulator: a simulator to end with the fleet, or None.

    Attributes:
        simulator: the same.
        zenoh_robots: the robots, as what they are.
    """

    def __init__(self, config: ZenohConfig, specs: Sequence[RobotSpec], simulator: Simulator | None) -> None:
        self.simulator: Final = simulator
        clock = VehicleClock(rate=config.speedup)
        robot_class = promising(config.promised())
        self._truth: Final = None if config.truth is None else StreamedTruth(config.truth, clock)
        try:
            self._session: Final = open_session(config.session)
        except BaseException:
            if self._truth is not None:
                self._truth.close()
            raise
        try:
            self.zenoh_robots: Final = tuple(robot_class(spec, clock, self._session, config) for spec in specs)
            super().__init__(clock, self.zenoh_robots, self._truth)
        except BaseException:
            self._close_shared()
            raise

    def _close(self) -> None:
        self._close_shared()
        if self.simulator is not None:
            self.simulator.close()

    def _close_shared(self) -> None:
        close_session(self._session)
        if self._truth is not None:
            self._truth.close()


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
        simulator = Simulator(config.workspace, robots, config.session, stamped=config.stamped, speedup=config.speedup)
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
