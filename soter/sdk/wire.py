"""Backends of robots on a wire: given robots, or simulated ones that are started for the run."""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, ClassVar, Final, Generic, Protocol, TypeVar

import msgspec
from pydantic import Field

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.geometry.site import SitePlan, plain
from soter.geometry.workspace import Workspace
from soter.sdk import program
from soter.sdk.backend import Backend, BackendConfig, Fleet
from soter.sdk.robot import Robot
from soter.sdk.truth import StreamedTruth
from soter.sdk.values import RobotSpec, RuleLimits


def describe(workspace: Workspace, robots: Sequence[RobotSpec], limits: RuleLimits) -> bytes:
    """Return a world in the encoding that simulators read; see `soter_sim.program.read_world`."""
    made_of = plain(workspace)
    both = (None, made_of) if isinstance(made_of, SitePlan) else (made_of, None)
    return msgspec.msgpack.encode((*both, robots, limits))


class Runs(Protocol):
    """Processes that were started for a fleet, and end with it."""

    def lost(self) -> str:
        """Return, in words, which process has ended; empty while all run."""

    def close(self) -> None:
        """End the processes, and wait until they are gone. Idempotent."""


S = TypeVar("S", bound=Runs)


class Simulator(program.Program):
    """Simulated robots in a process of their own, whose clocks and restarts tests can control.

    Args:
        module: the simulator's module; see `soter_sim.commanded`.
        workspace: the robots' world.
        robots: the robots, and where they start.
        limits: what the mission promises.
        at: by robot, the address that an earlier simulator gave it; for robots that come back at the same address.

    Attributes:
        robots: by robot, its address, as the simulator says.
        faults: brings faults into the robots.

    Raises:
        RobotUnavailable: the simulator does not start.
    """

    def __init__(
        self,
        module: str,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
        at: Mapping[int, Any] | None = None,
    ) -> None:
        described = describe(workspace, robots, limits)
        super().__init__("the simulator", module, described, "--at", json.dumps(at or {}))
        self.robots: Final[dict[int, Any]] = {int(robot_id): each for robot_id, each in self.told["robots"].items()}
        self.faults: Final = program.Faults(self.told["control"])


class WireFleet(Fleet, Generic[S]):
    """Robots on a wire, what they share, and the simulator if one was started for them.

    Args:
        clock: follows the robots' clocks.
        robots: in the order in which they were requested.
        truth: `host:port` of a simulated world's ground truth, or None.
        simulator: a simulator to end with the fleet, or None.
        shared: closed after the robots; the fleet takes it over.

    Raises:
        RobotUnavailable: no truth is sent there; `shared` was not taken over.
    """

    robots: tuple[Any, ...]

    def __init__(
        self, clock: VehicleClock, robots: Sequence[Robot], truth: str | None, simulator: S | None, shared: ExitStack
    ) -> None:
        told = None if truth is None else StreamedTruth(truth, clock)
        super().__init__(clock, robots, told)
        self.simulator: Final = simulator
        self.__shared: Final = shared.pop_all()
        if told is not None:
            self.__shared.callback(told.close)

    def lost(self) -> str:
        return "" if self.simulator is None else self.simulator.lost()

    def _close(self) -> None:
        with ExitStack() as stack:
            if self.simulator is not None:
                stack.callback(self.simulator.close)
            stack.callback(self.__shared.close)


class WireConfig(BackendConfig):
    """The configuration of backends on a wire. An adapter's own model may give addresses a type of its own.

    Attributes:
        robots: by number, the robots' addresses; if none is given, simulated robots are started.
        truth: `host:port` of the ground truth of a simulator that was started by hand.
    """

    robots: dict[int, Any] = Field(default_factory=dict)
    truth: str | None = None


class WireBackend(Backend):
    """Opens robots on a wire."""

    simulated_by: ClassVar[str]
    """The module of simulated robots that `python -m` runs; see `soter_sim.commanded`."""

    @abstractmethod
    def connect(
        self, config: Any, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Robot]:
        """Return the robots at the addresses of `config`, which are all given; push what to close last on `shared`."""

    @classmethod
    def clock(cls, config: Any) -> VehicleClock:
        """Return a clock that will follow the robots' clocks."""
        return VehicleClock()

    @classmethod
    def simulate(cls, config: Any, robots: Sequence[RobotSpec]) -> Any:
        """Start simulated robots in the world of `config`; return a `Simulator`, or anything that `located` takes."""
        return Simulator(cls.simulated_by, config.workspace, robots, config.limits)

    @classmethod
    def located(cls, config: Any, simulator: Any) -> Any:
        """Return the configuration with a simulator's robots in it."""
        # Validated like addresses that are given by hand.
        return type(config).model_validate({**dict(config), "robots": simulator.robots, "truth": simulator.truth})

    def open(self, config: Any, robots: Sequence[RobotSpec]) -> WireFleet[Any]:
        """Open the robots; they are not ready before `init()`.

        Raises:
            RobotUnavailable: a robot has no address, or the simulated ones do not start.
        """
        missing = [spec.id for spec in robots if spec.id not in config.robots]
        if config.robots and missing:
            raise RobotUnavailable(
                f"no address is given for the robots {missing}; add them to the backend's table `robots`, or remove "
                "all addresses to have simulated robots"
            )
        clock = self.clock(config)
        with ExitStack() as started, ExitStack() as shared:
            simulator = None
            if not config.robots:
                simulator = self.simulate(config, robots)
                started.callback(simulator.close)
                config = self.located(config, simulator)
            fleet = WireFleet(clock, self.connect(config, robots, clock, shared), config.truth, simulator, shared)
            started.pop_all()
            return fleet
