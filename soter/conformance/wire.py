"""A harness for backends that start simulated robots; subclasses for different wires bring their own relay."""

from __future__ import annotations

import json
import pkgutil
import subprocess
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

from soter.conformance.harness import LIMITS, Killable, Switchable
from soter.conformance.relayed import WIDE_ROOMS, Relay, RelayedHarness, in_wide_rooms
from soter.sdk import Fleet, RobotSpec, RuleLimits, Waypoint
from soter.sdk.wire import Simulator, WireBackend


class WireRelay(Relay, Protocol):
    """A relay with addresses that stand for the robots'."""

    @property
    def addresses(self) -> Mapping[int, Any]:
        """The relay's address for each robot, as in the adapter's configuration."""


class WireHarness(RelayedHarness):
    """Opens simulated robots behind a relay, started for every fleet, at free addresses."""

    backend: ClassVar[type[WireBackend]]
    limits: RuleLimits = LIMITS

    def __init__(self) -> None:
        super().__init__()
        self._beside: list[WireRelay] = []

    @abstractmethod
    def impair(self, addresses: Mapping[int, Any]) -> WireRelay:
        """Return a relay to the robots at these addresses."""

    def open(self, robots: int) -> Fleet:
        self.relay = relay = self.impair(self._start(robots).robots)
        self.fleet = self._connect(relay)
        return self.fleet

    def close(self) -> None:
        super().close()
        for relay in self._beside:
            relay.close()
        self._beside.clear()

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator, backend = self._start(1), self.backend
        given = {"robots": simulator.robots, "truth": simulator.truth}
        argument = json.dumps([f"{backend.__module__}:{backend.__qualname__}", given])
        return self.driven(f"{__name__}:open_given", argument, target)

    def second(self) -> Fleet:
        """Return another program's connection to the robots of the open fleet, beside the first one.

        The connection has a relay of its own, so that robots see a different sender.
        """
        relay = self.impair(self._simulated().robots)
        self._beside.append(relay)
        return self._connect(relay)

    def step_clock(self, robot_id: int, seconds: float) -> None:
        """Set a vehicle's own clock forward, or back if negative, while its program goes on."""
        self._simulated().faults.step_clock(robot_id, seconds)

    def stop_clock(self, robot_id: int) -> None:
        """Let a vehicle's own clock stand still from now on, while its program goes on."""
        self._simulated().faults.stop_clock(robot_id)

    def restart(self, robot_id: int) -> None:
        """Restart a vehicle's program, which forgets active controller, target and lease; its clock begins at 0."""
        self._simulated().faults.restart(robot_id)

    def stall(self, robot_id: int, seconds: float) -> None:
        """Suspend the robots' program; when it goes on, it makes up for the simulated time."""
        self.stopped(self._simulated().process, seconds)

    def switchable(self) -> Switchable:
        """Return a fleet of one fresh robot without a relay, and its switch; there is no truth while it is off."""
        robots = self._start(1).robots
        self.fleet = _open(self.backend, robots, None, self.asked(1))
        return Switchable(self.fleet, self._end, lambda: self._begin_anew(robots))

    def killable(self) -> Killable:
        """Return a fleet of one robot that the backend simulates itself, and the call that kills its program."""
        config = self.backend.config_model(workspace=WIDE_ROOMS, limits=self.limits)
        self.fleet = fleet = self.backend().open(config, self.specs(1))
        assert isinstance(fleet.simulator, Simulator)
        return Killable(fleet, fleet.simulator.process.kill)

    def _begin_anew(self, robots: Mapping[int, Any]) -> None:
        self._watch(Simulator(self.backend.simulated_by, WIDE_ROOMS, self.specs(1), self.limits, at=robots))

    def _connect(self, relay: WireRelay) -> Fleet:
        simulator = self._simulated()
        return _open(self.backend, relay.addresses, simulator.truth, self.asked(len(simulator.robots)))

    def _simulated(self) -> Simulator:
        assert isinstance(self.simulator, Simulator)
        return self.simulator

    def _start(self, robots: int) -> Simulator:
        config: Any = self.backend.config_model(workspace=WIDE_ROOMS, limits=self.limits)
        simulator: Simulator = self.backend.simulate(config, self.specs(robots))
        self._watch(simulator)
        return simulator


def open_given(argument: str) -> Fleet:
    """Return a fleet of the first robot at addresses given as JSON; called in the kit's driver process."""
    target, given = json.loads(argument)
    return _open(pkgutil.resolve_name(target), given["robots"], given["truth"], in_wide_rooms(1))


def _open(
    backend: type[WireBackend], addresses: Mapping[int, Any], truth: str | None, robots: Sequence[RobotSpec]
) -> Fleet:
    config = backend.config_model.model_validate({"workspace": WIDE_ROOMS, "robots": addresses, "truth": truth})
    return backend().open(config, robots)
