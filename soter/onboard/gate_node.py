"""The velocity gate as a node of a robot. Standard library only.

It takes orders and velocities, and passes on the velocities of the active controller.
"""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

from soter.onboard.velocity import REST, Velocity, VelocityGate
from soter.onboard.wire import Order

LEASE_S: Final = 0.13
COMMAND_S: Final = 0.25
V_MAX_M_S: Final = 0.22
YAW_RATE_MAX_RAD_S: Final = 2.84
PERIOD_S: Final = 0.02
"""Period for calls of `look`, which checks whether the present velocity may still pass."""

logger = logging.getLogger(__name__)


class GateNode(ABC):
    """Passes on the velocities of the active controller while its lease lives. Not thread-safe.

    A subclass for a middleware calls `hear_order` and `hear` with its messages, `look` every `PERIOD_S`, and implements
    the underscored methods.

    Args:
        gate: the robot's gate.
        rate: seconds of the robot's clock per host second, above 1 in a simulated world that runs faster.
        steady: the host's monotonic time in seconds.

    Attributes:
        senseless: how many malformed orders were dropped.
    """

    def __init__(self, gate: VelocityGate, rate: float = 1.0, steady: Callable[[], float] = time.monotonic) -> None:
        self._gate: Final = gate
        self._steady: Final = steady
        self._rate: Final = rate
        self._passed = False
        self.senseless = 0

    def hear_order(self, text: str | bytes) -> None:
        """Apply an order and report the gate's state; a malformed order is counted and the first one logged."""
        try:
            order = Order.decode(text)
        except ValueError as failure:
            self.senseless += 1
            if self.senseless == 1:
                self._warn(f"dropped an order that makes no sense: {failure}")
            return
        now_s, clock_s = self._now_s(), self._clock_s()
        age_s = None if clock_s is None or order.renewed_s is None else clock_s - order.renewed_s
        if self._gate.take(order, age_s, now_s):
            self.report()
            self.look()

    def hear(self, by: str, velocity: Velocity) -> None:
        """Take a controller's velocity."""
        if self._gate.give(by, velocity, self._now_s()):
            self.look()

    def look(self) -> None:
        """Pass on the velocity that may move the robot now, or rest."""
        velocity = self._gate.passing(self._now_s())
        if (velocity is not None) != self._passed:
            self._passed = velocity is not None
            self.report()
        self._pass_on(velocity or REST)

    def report(self) -> None:
        """Send a report of the gate's state."""
        self._say(self._gate.report(self._now_s()).encode())

    def _now_s(self) -> float:
        # Not the robot's clock: if that is set or stands still, the robot must still stop.
        return self._steady() * self._rate

    def _warn(self, text: str) -> None:
        """Log a warning for users."""
        logger.warning("%s", text)

    @abstractmethod
    def _clock_s(self) -> float | None:
        """Return the time of the robot's clock, or None while it is not known."""

    @abstractmethod
    def _pass_on(self, velocity: Velocity) -> None:
        """Send a velocity to the base."""

    @abstractmethod
    def _say(self, report: str) -> None:
        """Send a report to the supervisor."""
