"""The base of one simulated robot as a ROS node: clock, odometry and battery out, velocity in."""

from __future__ import annotations

from math import cos, sin
from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from soter_sim.velocity_controlled import VelocityControlledBase
from soter_sim.world import World

CLOCK: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def to_ros(time_s: float) -> Any:
    """Return a builtin_interfaces/Time."""
    return Time(nanoseconds=round(time_s * 1e9)).to_msg()


class Base(VelocityControlledBase):
    """One robot.

    Args:
        node: a node in the robot's namespace.
        world: the robot's world.
        robot_id: its number.
        stamped: whether velocities come as TwistStamped.
    """

    def __init__(self, node: Node, world: World, robot_id: int, *, stamped: bool) -> None:
        super().__init__(world, robot_id)
        self.node: Final = node
        self._frame: Final = node.get_namespace().strip("/")
        self._stamped: Final = stamped
        self._clock: Final = node.create_publisher(Clock, "clock", CLOCK)
        self._odometry: Final = node.create_publisher(Odometry, "odom", 1)
        self._battery: Final = node.create_publisher(BatteryState, "battery_state", 1)
        node.create_subscription(TwistStamped if stamped else Twist, "cmd_vel", self._hear, 1)

    def tell_clock(self) -> None:
        self._clock.publish(Clock(clock=to_ros(self.clock_s)))

    def tell_odometry(self) -> None:
        bodies, i = self._world.bodies, self._index
        message = Odometry()
        message.header.stamp = self._stamp()
        message.header.frame_id = f"{self._frame}/odom"
        message.child_frame_id = f"{self._frame}/base_link"
        pose, twist = message.pose.pose, message.twist.twist
        pose.position.x, pose.position.y = bodies.x[i], bodies.y[i]
        half = 0.5 * bodies.heading[i]
        pose.orientation.z, pose.orientation.w = sin(half), cos(half)
        twist.linear.x, twist.angular.z = bodies.v[i], bodies.yaw_rate[i]
        self._odometry.publish(message)

    def tell_battery(self) -> None:
        message = BatteryState()
        message.header.stamp = self._stamp()
        message.header.frame_id = f"{self._frame}/base_link"
        message.percentage = self._world.bodies.charge[self._index]
        message.present = True
        self._battery.publish(message)

    def _stamp(self) -> Any:
        return to_ros(self.clock_s)

    def _hear(self, message: Any) -> None:
        twist = message.twist if self._stamped else message
        self.drive(twist.linear.x, twist.angular.z)
