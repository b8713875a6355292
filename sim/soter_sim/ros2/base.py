"""The base of one simulated robot as a ROS node: odometry and battery out, velocity in."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin
from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import BatteryState

from soter_sim.velocity_controlled import VelocityControlledBase
from soter_sim.world import World


class Base(VelocityControlledBase):
    """One robot.

    Args:
        node: a node in the robot's namespace.
        world: the robot's world.
        robot_id: its number.
        stamp: returns the world's time as a ROS message.
        stamped: whether velocities come as TwistStamped.
    """

    def __init__(self, node: Node, world: World, robot_id: int, stamp: Callable[[], Any], *, stamped: bool) -> None:
        super().__init__(world, robot_id)
        self.node: Final = node
        self._stamp: Final = stamp
        self._frame: Final = node.get_namespace().strip("/")
        self._stamped: Final = stamped
        self._odometry: Final = node.create_publisher(Odometry, "odom", 1)
        self._battery: Final = node.create_publisher(BatteryState, "battery_state", 1)
        node.create_subscription(TwistStamped if stamped else Twist, "cmd_vel", self._hear, 1)

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

    def _hear(self, message: Any) -> None:
        twist = message.twist if self._stamped else message
        self.drive(twist.linear.x, twist.angular.z)
