"""Drives two robots at full speed towards each other for 15 s, then away for 25 s, out of the hall. Knows no SOTER."""

import rclpy
from geometry_msgs.msg import Twist, Vector3

rclpy.init()
node = rclpy.create_node("reckless")
wheels = [node.create_publisher(Twist, f"/robot{number}/cmd_vel_ac", 1) for number in (1, 2)]
began = node.get_clock().now()


def drive() -> None:
    forwards = (node.get_clock().now() - began).nanoseconds * 1e-9 % 40.0 < 15.0
    for wheel in wheels:
        wheel.publish(Twist(linear=Vector3(x=0.22 if forwards else -0.22)))


node.create_timer(0.05, drive)
rclpy.spin(node)
