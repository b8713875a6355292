"""A harness for robots that are simulated in another process, with a relay between them and the adapter."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Sequence
from typing import Final, Protocol

from soter.clock import VehicleClock
from soter.conformance import driver
from soter.conformance.harness import FOR_EVER_S, LEG_M, LIMITS, Harness, beside_leg, specs_at
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Capabilities, Fleet, RobotSpec, RuleLimits, Waypoint
from soter.sdk.truth import StreamedTruth


class Relay(Protocol):
    """Passes messages both ways between an adapter and its robots, and can impair them.

    Attributes:
        cut: robots whose messages are all lost.
        delay_s: delay of every message.
        loss: share of the messages that is lost.
        duplicate: share that is delivered twice.
        reorder: share that is delivered after its successors.
        garble: share that is followed by bytes that make no sense.
    """

    cut: frozenset[int]
    delay_s: float
    loss: float
    duplicate: float
    reorder: float
    garble: float

    def close(self) -> None:
        """Stop passing messages. Idempotent."""


class Witness(Protocol):
    """Observes where robots really are, independently of the adapter."""

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""

    def close(self) -> None:
        """Stop listening. Idempotent."""


class Closes(Protocol):
    """Anything started that must be closed."""

    def close(self) -> None:
        """End it. Idempotent."""


class Tells(Closes, Protocol):
    """A simulator that publishes the truth."""

    @property
    def truth(self) -> str:
        """Address at which the truth is published, as `host:port`."""


WIDE_ROOMS: Final = Workspace(
    150.0, 78.0, (beside_leg((142.5, 73.5)),),
    (
        RobotPlace(72, 142.5, 73.5, Box(142.3, 73.3, 142.7, 73.7), 0.7),
        RobotPlace(20, 146.5, 74.2, Box(146.3, 74.0, 146.7, 74.4), -2.1),
        RobotPlace(200, 143.3, 70.4, Box(143.1, 70.2, 143.5, 70.6), 2.5),
    ),
)  # fmt: skip
"""Three rooms of 2.4 m, for robots that take their time to stop; and a box beside the long leg of the first.

Ids are not 1 and 2 in order, so that ids taken for indices show. One begins with another and ends alike, so that names
looked up by either show. One has eight bits, and the lowest seven are another's, so that addresses of fewer show.
"""


def in_wide_rooms(
    robots: int,
    promised: Capabilities | None = None,
    charge: float | None = None,
    lasts_s: float = FOR_EVER_S,
    charge_s: float = FOR_EVER_S,
) -> list[RobotSpec]:
    """Return the first robots of `WIDE_ROOMS`, see `soter.conformance.harness.specs_at`."""
    return specs_at(WIDE_ROOMS.robots[:robots], promised, charge, lasts_s, charge_s)


class RelayedHarness(Harness):
    """Gives every optional hook by a relay and a witness; subclasses write `open` and `start_driver`.

    The attributes fit robots that are simulated in `WIDE_ROOMS`, each fleet at free addresses, under `LIMITS`.

    `open` sets `simulator`, `relay` and `fleet`; `start_driver` sets `simulator` and `witness`, and returns `driven`.
    The robots to simulate are `specs`; those to open through the adapter are `asked`.
    """

    room_m = 2.4
    leg_m = LEG_M
    limits: RuleLimits | None = LIMITS
    side_by_side = True
    charges_at_start = True
    contacts = True
    robots_most = len(WIDE_ROOMS.robots)

    def __init__(self) -> None:
        self.fleet: Fleet | None = None
        self.simulator: Closes | None = None
        self.relay: Relay | None = None
        self.witness: Witness | None = None
        self._drivers: list[subprocess.Popen[bytes]] = []
        self._promised: Capabilities | None = None
        self._charge: float | None = None
        self._lasts_s = self._charge_s = FOR_EVER_S
        self._order: Sequence[int] | None = None
        self._stalls: list[subprocess.Popen[bytes]] = []

    def specs(self, robots: int) -> list[RobotSpec]:
        """Return the first robots of `WIDE_ROOMS`, with their charge, and the promises asked of the last one."""
        return in_wide_rooms(robots, self._promised, self._charge, self._lasts_s, self._charge_s)

    def asked(self, robots: int) -> list[RobotSpec]:
        """Return the robots that the adapter is asked for: all, unless some were chosen."""
        there = self.specs(robots)
        return there if self._order is None else [there[each] for each in self._order]

    def promising(self, promised: Capabilities, robots: int = 1) -> Fleet:
        self._promised = promised
        return self.open(robots)

    def charged(self, charge: float, lasts_s: float = FOR_EVER_S, charge_s: float = FOR_EVER_S) -> Fleet:
        self._charge, self._lasts_s, self._charge_s = charge, lasts_s, charge_s
        return self.open(1)

    def choosing(self, order: Sequence[int]) -> Fleet:
        self._order = order
        return self.open(self.robots_most)

    def another(self) -> Harness:
        return type(self)()

    def close(self) -> None:
        for process in self._drivers:
            process.kill()
            process.wait()
        self._drivers.clear()
        for stall in self._stalls:
            stall.wait()
        self._stalls.clear()
        if self.relay is not None:
            self.relay.cut, self.relay.delay_s, self.relay.loss = frozenset(), 0.0, 0.0
        if self.fleet is not None:
            self.fleet.close()
        if self.relay is not None:
            self.relay.close()
        self._end()
        self.fleet = self.relay = None
        self._promised = self._charge = self._order = None

    def _watch(self, simulator: Tells) -> None:
        """Let the kit observe the truth of a simulator, which `close` ends."""
        self.simulator = simulator
        self.witness = StreamedTruth(simulator.truth, VehicleClock())

    def _end(self) -> None:
        """End the simulator and the witness."""
        for each in (self.witness, self.simulator):
            if each is not None:
                each.close()
        self.witness = self.simulator = None

    def driven(self, opener: str, argument: str, target: Waypoint) -> subprocess.Popen[bytes]:
        """Start a driver as `soter.conformance.driver.spawn` does; `close` ends it."""
        process = driver.spawn(opener, argument, target)
        self._drivers.append(process)
        return process

    def stopped(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        """Suspend a process of the robots for some seconds; return at once."""
        process.send_signal(signal.SIGSTOP)
        # A process of its own resumes it, whatever becomes of this one.
        self._stalls.append(
            subprocess.Popen(["/bin/sh", "-c", f"sleep {seconds}; kill -CONT {process.pid}"], start_new_session=True)
        )

    def cut(self, robot_id: int) -> None:
        self._link().cut |= {robot_id}

    def restore(self, robot_id: int) -> None:
        self._link().cut -= {robot_id}

    def delay(self, seconds: float) -> None:
        self._link().delay_s = seconds

    def loss(self, fraction: float) -> None:
        self._link().loss = fraction

    def duplicate(self, fraction: float) -> None:
        self._link().duplicate = fraction

    def reorder(self, fraction: float) -> None:
        self._link().reorder = fraction

    def garble(self, fraction: float) -> None:
        self._link().garble = fraction

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        assert self.witness is not None
        return self.witness.pose(robot_id)

    def _link(self) -> Relay:
        assert self.relay is not None
        return self.relay
