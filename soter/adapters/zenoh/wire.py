"""All that goes between SOTER and one robot on keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import zenoh

from soter.adapters.zenoh.messages import BatteryState, Odometry, String
from soter.adapters.zenoh.options import Keys
from soter.adapters.zenoh.presence import Presence, announce
from soter.adapters.zenoh.talk import Ear, Voice
from soter.adapters.zenoh.velocities import make_velocity, stamp_of
from soter.mux.wire import AC, SC


class Wire:
    """What is heard of a robot, what it is told, and who says to be there.

    Args:
        session: to hear and say over; somebody else's to close.
        namespace: of the robot.
        keys: of the robot, in full.
        stamped: whether velocities are TwistStamped.
        who: what this end says to be.

    Attributes:
        keys: the same.
        presence: who is there.
        ears: by what `Keys` calls what they hear; empty before `listen`.
    """

    def __init__(self, session: zenoh.Session, namespace: str, keys: Keys, *, stamped: bool, who: str) -> None:
        self.keys: Final = keys
        self.presence: Final = Presence(session, namespace)
        self.ears: Final[dict[str, Ear[Any]]] = {}
        self._session: Final = session
        self._stamped: Final = stamped
        self._token: Final = announce(session, namespace, who)
        self._velocities: Final = {AC: Voice(session, keys.cmd_vel_ac), SC: Voice(session, keys.cmd_vel_sc)}
        self._orders: Final = Voice(session, keys.order)

    def listen(
        self,
        take_odometry: Callable[[Odometry], object],
        take_battery: Callable[[BatteryState], object],
        take_report: Callable[[str], object],
    ) -> None:
        """Hand on what is heard from now on, each kind in a thread of its own."""
        session, keys, ears = self._session, self.keys, self.ears
        ears["gate"] = Ear(session, keys.gate, String, lambda message: take_report(message.data))
        if keys.battery:
            ears["battery"] = Ear(session, keys.battery, BatteryState, take_battery)
        ears["odom"] = Ear(session, keys.odom, Odometry, take_odometry)

    def send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float, clock_s: float) -> None:
        """Ask for a velocity in the name of a controller, at a time of the robot's clock."""
        stamp = stamp_of(clock_s) if self._stamped else None
        self._velocities[by].say(make_velocity(forward_m_s, turn_rad_s, stamp))

    def send_order(self, text: str) -> None:
        """Say who is in charge."""
        self._orders.say(String(text))
