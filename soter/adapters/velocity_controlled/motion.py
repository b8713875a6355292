"""Reads pose, velocity and charge of a robot from ROS messages.

Messages are read by the names of their fields, so that any library's classes will do.
"""

from __future__ import annotations

from math import atan2, cos, isfinite, nan, pi, remainder, sin
from typing import Any, Final, NamedTuple

Pose = tuple[float, float, float]
"""East and north in metres, heading in radians counter-clockwise from east."""

_SHORT: Final = 1e-6
_MOST: Final = 1e9


class MeasuredMotion(NamedTuple):
    """A robot's pose and velocity at a moment, in the workspace frame.

    Attributes:
        stamp_s: the robot's time.
        x_m: east.
        y_m: north.
        heading_rad: in (-pi, pi].
        forward_m_s: along its heading.
        leftward_m_s: to its left; 0 for a differential drive.
        turn_rad_s: counter-clockwise.
    """

    stamp_s: float
    x_m: float
    y_m: float
    heading_rad: float
    forward_m_s: float
    leftward_m_s: float
    turn_rad_s: float

    @property
    def possible(self) -> bool:
        """Whether all numbers are finite and, except for the stamp, at most 1e9."""
        return all(-_MOST <= value <= _MOST for value in self[1:]) and isfinite(self.stamp_s)

    @property
    def velocity(self) -> tuple[float, float]:
        """East and north, in m/s."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return self.forward_m_s * c - self.leftward_m_s * s, self.forward_m_s * s + self.leftward_m_s * c

    def after(self, seconds: float) -> MeasuredMotion:
        """Return the motion after some seconds with the same speed and turn rate."""
        turned = self.turn_rad_s * seconds
        length = self.forward_m_s * seconds
        middle = self.heading_rad + 0.5 * turned
        return self._replace(
            x_m=self.x_m + length * cos(middle), y_m=self.y_m + length * sin(middle),
            heading_rad=self.heading_rad + turned,
        )  # fmt: skip


def seconds(stamp: Any) -> float:
    """Return a builtin_interfaces/Time in seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def read_odometry(message: Any, origin: Pose) -> MeasuredMotion:
    """Return the motion in a nav_msgs/Odometry.

    Twists are in the frame of the robot's body, as nav_msgs defines; the pose is in the odometry's frame, which reads
    0, 0, 0 at `origin`. A heading that the message lacks is NaN.
    """
    position, turned = message.pose.pose.position, message.pose.pose.orientation
    twist = message.twist.twist
    # The yaw of any quaternion: the robot may be tilted, and the length need not be 1.
    yaw = atan2(
        2.0 * (turned.w * turned.z + turned.x * turned.y),
        turned.w * turned.w + turned.x * turned.x - turned.y * turned.y - turned.z * turned.z,
    )
    if turned.w * turned.w + turned.x * turned.x + turned.y * turned.y + turned.z * turned.z < _SHORT:
        # A quaternion that was not filled in has length 0.
        yaw = nan
    c, s = cos(origin[2]), sin(origin[2])
    heading = remainder(origin[2] + yaw, 2.0 * pi)
    return MeasuredMotion(
        seconds(message.header.stamp),
        origin[0] + c * position.x - s * position.y,
        origin[1] + s * position.x + c * position.y,
        pi if heading == -pi else heading,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
    )


class Charge(NamedTuple):
    """A reported charge from 0 to 1, and the robot's time of the report."""

    stamp_s: float
    level: float


def read_battery(message: Any) -> Charge | None:
    """Return the charge in a sensor_msgs/BatteryState; None if it is NaN, for not known, or not from 0 to 1."""
    level = float(message.percentage)
    return Charge(seconds(message.header.stamp), level) if 0.0 <= level <= 1.0 else None
