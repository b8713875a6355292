"""Which velocity may move a robot now: orders, the two controllers' streams, and the lease. Standard library only."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from soter.mux import Mux
from soter.mux.wire import SC, GateReport, Order


class Velocity(NamedTuple):
    """What a differential-drive robot is asked for.

    Attributes:
        forward_m_s: along its heading.
        turn_rad_s: counter-clockwise.
    """

    forward_m_s: float = 0.0
    turn_rad_s: float = 0.0


REST: Final = Velocity()


class Gate:
    """Passes the velocity of the controller in charge, within the limits, while its lease lives.

    It follows one session, and another only when the lease of that one is dead, so that two programs cannot fight over
    a robot. All times are the caller's steady time: a robot's clock that is set, or stands still, prolongs nothing.

    Args:
        lease_s: a lease lives this long after its renewal.
        command_s: a velocity counts this long after it came.
        v_max_m_s: no velocity beyond this passes.
        yaw_rate_max_rad_s: nor any turn rate beyond this.
    """

    def __init__(self, lease_s: float, command_s: float, v_max_m_s: float, yaw_rate_max_rad_s: float) -> None:
        for name, value in (("v_max_m_s", v_max_m_s), ("yaw_rate_max_rad_s", yaw_rate_max_rad_s)):
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} is {value}, allowed: finite and above 0")
        self._mux: Final[Mux[str, Velocity]] = Mux(SC, lease_s, command_s)
        self._v_max_m_s: Final = v_max_m_s
        self._yaw_rate_max_rad_s: Final = yaw_rate_max_rad_s
        self._session = ""
        self._seq = 0
        self._renewed_s = -math.inf

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
        elif order.seq <= self._seq:
            return False
        self._session, self._seq = order.session, order.seq
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

    def give(self, by: str, velocity: Velocity, now_s: float) -> bool:
        """Take what a controller asks for; return whether it is in charge. What is not finite stops the robot."""
        if not math.isfinite(velocity.forward_m_s + velocity.turn_rad_s):
            velocity = REST
        return self._mux.give(by, velocity, now_s)

    def passing(self, now_s: float) -> Velocity | None:
        """Return what may move the robot now, or None: rest."""
        velocity = self._mux.passing(now_s)
        if velocity is None:
            return None
        v_m_s, turn_rad_s = self._v_max_m_s, self._yaw_rate_max_rad_s
        return Velocity(
            max(-v_m_s, min(v_m_s, velocity.forward_m_s)), max(-turn_rad_s, min(turn_rad_s, velocity.turn_rad_s))
        )

    def report(self, now_s: float) -> GateReport:
        """Return what it does now."""
        return GateReport(self._session, self._seq, self._mux.in_charge, self._mux.alive(now_s))
