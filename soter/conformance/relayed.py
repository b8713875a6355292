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
    """Passes messages both ways between an adapter and its robots, or does worse to them.

    Attributes:
        cut: robots that nothing gets through to or from.
        delay_s: every message comes so much later.
        loss: share of the messages that is lost.
        duplicate: share that comes twice.
        reorder: share that comes after those that followed.
    """

    cut: frozenset[int]
    delay_s: float
    loss: float
    duplicate: float
    reorder: float

    def close(self) -> None:
        """Stop passing. Idempotent."""


class Witness(Protocol):
    """Hears what really happens, beside the adapter."""

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""

    def close(self) -> None:
        """Stop listening. Idempotent."""


class Closes(Protocol):
    """Something that was started and ends."""

    def close(self) -> None:
        """End it. Idempotent."""


class Tells(Closes, Protocol):
    """Robots that are simulated."""

    @property
    def truth(self) -> str:
        """Where it is told what really happens, as `host:port`."""


WIDE_ROOMS: Final = Workspace(
    150.0, 78.0, (beside_leg((142.5, 73.5)),),
    (
        RobotPlace(7, 142.5, 73.5, Box(142.3, 73.3, 142.7, 73.7), 0.7),
        RobotPlace(3, 146.5, 74.2, Box(146.3, 74.0, 146.7, 74.4), -2.1),
        RobotPlace(37, 143.3, 70.4, Box(143.1, 70.2, 143.5, 70.6), 2.5),
    ),
)  # fmt: skip
"""Three rooms of 2.4 m, for robots that take their time to stop; and a box beside the long leg of the first.

Ids are neither 1 and 2 nor in order: they are no indices. One begins with another, as names do by which a wire may look
things up.
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
    """Gives every optional hook by a relay and a witness; `open` and `start_driver` are the adapter's.

    What stands here fits robots that are simulated in `WIDE_ROOMS`, each fleet at free addresses, under `LIMITS`.

    `open` sets `simulator`, `relay` and `fleet`; `start_driver` sets `simulator` and `witness`, and returns `driven`.
    What is simulated is `specs`; what the adapter is asked for is `asked`.
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
        """Return the first robots of `WIDE_ROOMS`, with what the last of them is asked to promise, and their charge."""
        return in_wide_rooms(robots, self._promised, self._charge, self._lasts_s, self._charge_s)

    def asked(self, robots: int) -> list[RobotSpec]:
        """Return which of so many robots the adapter is asked for: all, unless some were chosen."""
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
        """Have the kit see what is really happening in a simulator, which is ended by `close`."""
        self.simulator = simulator
        self.witness = StreamedTruth(simulator.truth, VehicleClock())

    def _end(self) -> None:
        """End what is simulated, and who hears of it."""
        for each in (self.witness, self.simulator):
            if each is not None:
                each.close()
        self.witness = self.simulator = None

    def driven(self, opener: str, argument: str, target: Waypoint) -> subprocess.Popen[bytes]:
        """Start a driver as `soter.conformance.driver.spawn` does; it is ended by `close`."""
        process = driver.spawn(opener, argument, target)
        self._drivers.append(process)
        return process

    def stopped(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        """Let a process of the robots' stand still for so long from now; return at once."""
        process.send_signal(signal.SIGSTOP)
        # By a process of its own, so that it goes on whatever becomes of this one.
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

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        assert self.witness is not None
        return self.witness.pose(robot_id)

    def _link(self) -> Relay:
        assert self.relay is not None
        return self.relay
