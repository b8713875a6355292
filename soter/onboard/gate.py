"""Whose commands a robot follows: one session at a time, by growing numbers, while its lease lives."""

from __future__ import annotations

import math
from typing import Final, Generic, TypeVar

from soter.onboard.mux import Mux
from soter.onboard.wire import SC, GateReport, Order

T = TypeVar("T")
"""What a controller asks for, such as a goal or a velocity."""

_JUMP_MOST: Final = 1000
"""So many orders cannot have been missed while the lease lived, which one in thousands would have renewed."""

_FORGET_S: Final = 1.0
"""No order is under way for so long; after this without one, a lower number is that of a new beginning."""


class Gate(Generic[T]):
    """Passes what the controller in charge asks for, while its lease lives.

    It follows one session, and another only when the lease of that one is dead, so that two programs cannot fight over
    a robot. All times are the caller's steady time: a robot's clock that is set, or stands still, prolongs nothing.

    An order that comes twice or late is known by its number. A number far ahead is nobody's while the lease lives, and
    numbers count anew once it is dead and no order was taken for a second: who forges one does not shut out for good
    who gives the orders.

    Args:
        lease_s: a lease lives this long after its renewal.
        command_s: what a controller asks for counts this long after it came.
    """

    def __init__(self, lease_s: float, command_s: float = math.inf) -> None:
        self._mux: Final[Mux[str, T]] = Mux(SC, lease_s, command_s)
        self._session = ""
        self._seq = 0
        self._renewed_s = self._taken_s = -math.inf

    @property
    def command(self) -> T | None:
        """What the controller in charge asked for last, or None; it passes only while the lease lives."""
        return self._mux.command

    def take(self, order: Order, age_s: float | None, now_s: float) -> bool:
        """Take an order; return False, and change nothing, if it is not to be followed.

        Args:
            order: what it says.
            age_s: how long ago its lease was renewed, by the robot's clock; None if that clock is not known. A renewal
                that waited somewhere counts from when it was sent, and without a clock nothing is renewed.
            now_s: steady time.
        """
        mux = self._mux
        if order.session != self._session:
            if mux.alive(now_s):
                return False
            self._renewed_s = -math.inf
            # What the one before asked for was not judged by whoever renews now.
            mux.revoke()
        elif not self._follows(order.seq, now_s):
            return False
        self._session, self._seq, self._taken_s = order.session, order.seq, now_s
        # A change of hands drops what the other had in flight, whatever else the order says.
        mux.switch(order.controller)
        if order.renewed_s is None:
            self._renewed_s = -math.inf
            mux.revoke()
        elif age_s is not None:
            # A sender whose idea of this clock runs ahead must not thereby get a longer lease.
            self._renewed_s = max(self._renewed_s, now_s - max(age_s, 0.0))
            mux.renew(self._renewed_s)
        return True

    def give(self, by: str, command: T, now_s: float) -> bool:
        """Take what a controller asks for; return whether it is in charge."""
        return self._mux.give(by, command, now_s)

    def halt(self) -> None:
        """Drop what the controller in charge asked for."""
        self._mux.halt()

    def passing(self, now_s: float) -> T | None:
        """Return what may move the robot now, or None: rest."""
        return self._mux.passing(now_s)

    def report(self, now_s: float) -> GateReport:
        """Return what it does now."""
        return GateReport(self._session, self._seq, self._mux.in_charge, self._mux.alive(now_s))

    def _follows(self, seq: int, now_s: float) -> bool:
        """Return whether a number of the session that is followed is that of an order to take."""
        if self._mux.alive(now_s):
            return self._seq < seq <= self._seq + _JUMP_MOST
        # The last one again is never new: a latched topic repeats it to whoever comes back.
        return seq > self._seq or (seq < self._seq and now_s - self._taken_s >= _FORGET_S)
