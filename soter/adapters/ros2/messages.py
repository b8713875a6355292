"""ROS messages and SOTER's values: the only place where one becomes the other."""

from __future__ import annotations

from math import atan2, cos, pi, remainder, sin
from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

Pose = tuple[float, float, float]
"""East and north in metres, heading in radians counter-clockwise from east."""


class Motion(NamedTuple):
    """Where a robot was at a moment, and how it moved, in the workspace frame.

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
    def velocity(self) -> tuple[float, float]:
        """East and north, in m/s."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return self.forward_m_s * c - self.leftward_m_s * s, self.forward_m_s * s + self.leftward_m_s * c

    def after(self, seconds: float) -> Motion:
        """Return where it is so much later if it goes on as it does."""
        turned = self.turn_rad_s * seconds
        length = self.forward_m_s * seconds
        middle = self.heading_rad + 0.5 * turned
        return self._replace(
            x_m=self.x_m + length * cos(middle), y_m=self.y_m + length * sin(middle),
            heading_rad=self.heading_rad + turned,
        )  # fmt: skip


def stamp_s(header: Any) -> float:
    """Return the time of a std_msgs/Header, in seconds."""
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def read_odometry(message: Odometry, origin: Pose) -> Motion:
    """Return what an odometry message says.

    Twists are in the frame of the robot's body, as nav_msgs has it; the position in that of its odometry, which reads
    0, 0, 0 at `origin`.
    """
    position, turned = message.pose.pose.position, message.pose.pose.orientation
    twist = message.twist.twist
    # The yaw of a quaternion that need not be that of a robot on level ground, nor of length 1.
    yaw = atan2(
        2.0 * (turned.w * turned.z + turned.x * turned.y),
        turned.w * turned.w + turned.x * turned.x - turned.y * turned.y - turned.z * turned.z,
    )
    c, s = cos(origin[2]), sin(origin[2])
    heading = remainder(origin[2] + yaw, 2.0 * pi)
    return Motion(
        stamp_s(message.header),
        origin[0] + c * position.x - s * position.y,
        origin[1] + s * position.x + c * position.y,
        pi if heading == -pi else heading,
        twist.linear.x,
        twist.linear.y,
        twist.angular.z,
    )


class Charge(NamedTuple):
    """What was said of a battery, and when.

    Attributes:
        stamp_s: the robot's time.
        level: 0 to 1.
    """

    stamp_s: float
    level: float

    def at_least(self, now_s: float, drive_per_s: float) -> float:
        """Return the charge that is left at the robot's time `now_s`, if it has driven ever since."""
        return max(0.0, self.level - drive_per_s * max(0.0, now_s - self.stamp_s))


def read_battery(message: BatteryState) -> Charge | None:
    """Return what a battery message says; None where it does not know, which is NaN in ROS, or says nonsense."""
    level = float(message.percentage)
    return Charge(stamp_s(message.header), level) if 0.0 <= level <= 1.0 else None


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
