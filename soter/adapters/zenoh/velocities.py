"""Velocities of a differential-drive robot as messages, stamped or not."""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from soter.adapters.zenoh.messages import Header, Time, Twist, TwistStamped, Vector3
from soter.adapters.zenoh.talk import Ear


def make_velocity(forward_m_s: float, turn_rad_s: float, stamp: Time | None = None) -> Twist | TwistStamped:
    """Return a velocity as a message: a TwistStamped where there is a stamp."""
    twist = Twist(Vector3(x=forward_m_s), Vector3(z=turn_rad_s))
    return twist if stamp is None else TwistStamped(Header(stamp), twist)


def hear_velocity(
    session: zenoh.Session,
    key: str,
    take: Callable[[float, float], object],
    *,
    stamped: bool,
    elsewhere_only: bool = False,
) -> Ear[Twist] | Ear[TwistStamped]:
    """Hear velocities on a key.

    Args:
        session: to hear over.
        key: where.
        take: called with each, in m/s along the heading and rad/s counter-clockwise, in the ear's thread.
        stamped: whether they are TwistStamped.
        elsewhere_only: whether to leave out what this session says itself.
    """

    def take_twist(twist: Twist) -> None:
        take(twist.linear.x, twist.angular.z)

    if stamped:
        return Ear(session, key, TwistStamped, lambda message: take_twist(message.twist), elsewhere_only=elsewhere_only)
    return Ear(session, key, Twist, take_twist, elsewhere_only=elsewhere_only)


def stamp_of(clock_s: float) -> Time:
    """Return a time as messages have it."""
    seconds, nanoseconds = divmod(round(clock_s * 1e9), 1_000_000_000)
    return Time(seconds, nanoseconds)
