"""A harness for robots that are simulated in another process, with a relay between them and the adapter."""

from __future__ import annotations

import subprocess
from typing import Final, Protocol

from soter.conformance import driver
from soter.conformance.harness import Harness, specs_at
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Fleet, RobotSpec, Waypoint


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


WIDE_ROOMS: Final = Workspace(
    150.0, 78.0, (),
    (
        RobotPlace(7, 142.5, 73.5, Box(142.3, 73.3, 142.7, 73.7), 0.7),
        RobotPlace(3, 146.5, 74.2, Box(146.3, 74.0, 146.7, 74.4), -2.1),
    ),
)  # fmt: skip
"""Two rooms of 2.4 m, for robots that take their time to stop.

Ids are neither 1 and 2 nor in order: they are no indices.
"""


def in_wide_rooms(robots: int) -> list[RobotSpec]:
    """Return the first robots of `WIDE_ROOMS`, with a battery that is not full."""
    return specs_at(WIDE_ROOMS.robots[:robots])


class RelayedHarness(Harness):
    """Gives every optional hook by a relay and a witness; `open` and `start_driver` are the adapter's.

    `open` sets `simulator`, `relay` and `fleet`; `start_driver` sets `simulator` and `witness`, and returns `driven`.
    """

    charges_at_start = True
    contacts = True

    def __init__(self) -> None:
        self.fleet: Fleet | None = None
        self.simulator: Closes | None = None
        self.relay: Relay | None = None
        self.witness: Witness | None = None
        self._drivers: list[subprocess.Popen[bytes]] = []

    def close(self) -> None:
        for process in self._drivers:
            process.kill()
            process.wait()
        self._drivers.clear()
        if self.relay is not None:
            self.relay.cut, self.relay.delay_s, self.relay.loss = frozenset(), 0.0, 0.0
        if self.fleet is not None:
            self.fleet.close()
        for each in (self.relay, self.witness, self.simulator):
            if each is not None:
                each.close()
        self.fleet = self.relay = self.witness = self.simulator = None

    def driven(self, opener: str, argument: str, target: Waypoint) -> subprocess.Popen[bytes]:
        """Start a driver as `soter.conformance.driver.spawn` does; it is ended by `close`."""
        process = driver.spawn(opener, argument, target)
        self._drivers.append(process)
        return process

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
