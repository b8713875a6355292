"""The gate: a robot follows the commands of one session at a time, by growing numbers, while its lease lives."""

from __future__ import annotations

import math
from typing import Final, Generic, TypeVar

from soter.onboard.mux import Mux
from soter.onboard.wire import SC, GateReport, Order

T = TypeVar("T")
"""A controller's command, such as a goal or a velocity."""

_JUMP_MOST: Final = 1000
"""More orders than a robot can have missed while the lease lived, which needs them for its renewal."""

_FORGET_S: Final = 1.0
"""Longest delay of an order; after this time without one, a lower number marks a new beginning."""


class Gate(Generic[T]):
    """Passes the command of the active controller, while the lease lives.

    A gate follows one session, and another only when the lease is dead, so that two programs cannot fight over a robot.
    All times are the caller's steady time: a robot's clock that is set, or stands still, prolongs nothing.

    A double or late order is known by its number. A number far ahead is refused while the lease lives, and numbers
    begin anew once the lease is dead and no order was taken for a second: a forged number does not shut out the true
    sender for good.

    Args:
        lease_s: a lease lives this long after its renewal.
        command_s: a command counts this long after its arrival.
    """

    def __init__(self, lease_s: float, command_s: float = math.inf) -> None:
        self._mux: Final[Mux[str, T]] = Mux(SC, lease_s, command_s)
        self._session = ""
        self._seq = 0
        self._renewed_s = self._taken_s = -math.inf

    @property
    def command(self) -> T | None:
        """The active controller's latest command, or None; it passes only while the lease lives."""
        return self._mux.command

    def take(self, order: Order, age_s: float | None, now_s: float) -> bool:
        """Take an order; return False, and change nothing, if it must not be followed.

        Args:
            order: the order.
            age_s: time since its renewal of the lease, by the robot's clock; None if that clock is not known. A delayed
                renewal counts from when it was sent, and without a clock nothing is renewed.
            now_s: steady time.
        """
        mux = self._mux
        if order.session != self._session:
            if mux.alive(now_s):
                return False
            self._renewed_s = -math.inf
            # The new session's supervisor has not judged the command of the old one.
            mux.revoke()
        elif not self._follows(order.seq, now_s):
            return False
        self._session, self._seq, self._taken_s = order.session, order.seq, now_s
        # A switch drops the other controller's command, whatever else the order says.
        mux.switch(order.controller)
        if order.renewed_s is None:
            self._renewed_s = -math.inf
            mux.revoke()
        elif age_s is not None:
            # A sender whose estimate of this clock runs ahead must not get a longer lease by it.
            self._renewed_s = max(self._renewed_s, now_s - max(age_s, 0.0))
            mux.renew(self._renewed_s)
        return True

    def give(self, by: str, command: T, now_s: float) -> bool:
        """Take a controller's command; return whether the controller is active."""
        return self._mux.give(by, command, now_s)

    def halt(self) -> None:
        """Drop the active controller's command."""
        self._mux.halt()

    def passing(self, now_s: float) -> T | None:
        """Return the command that may move the robot now, or None for rest."""
        return self._mux.passing(now_s)

    def report(self, now_s: float) -> GateReport:
        """Return the gate's state now."""
        return GateReport(self._session, self._seq, self._mux.in_charge, self._mux.alive(now_s))

    def _follows(self, seq: int, now_s: float) -> bool:
        """Return whether an order of the followed session with this number is to be taken."""
        if self._mux.alive(now_s):
            return self._seq < seq <= self._seq + _JUMP_MOST
        # The last number again is never new: a latched topic repeats its message to a subscriber that comes back.
        return seq > self._seq or (seq < self._seq and now_s - self._taken_s >= _FORGET_S)
