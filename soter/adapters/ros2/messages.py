"""The velocities that ROS 2 robots are sent."""

from __future__ import annotations

from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped

KINDS: Final = {False: "geometry_msgs/msg/Twist", True: "geometry_msgs/msg/TwistStamped"}
"""The type of a velocity, by whether it is stamped."""


def velocity_type(*, stamped: bool) -> Any:
    """Return the class of messages for velocities."""
    return TwistStamped if stamped else Twist


def make_velocity(forward_m_s: float, turn_rad_s: float, stamp: Any, *, stamped: bool) -> Any:
    """Return a velocity as a message; `stamp` is a builtin_interfaces/Time, used where it is stamped."""
    message = velocity_type(stamped=stamped)()
    twist = message.twist if stamped else message
    twist.linear.x, twist.angular.z = forward_m_s, turn_rad_s
    if stamped:
        message.header.stamp = stamp
    return message
