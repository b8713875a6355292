from __future__ import annotations

import math

import pytest

pytestmark = pytest.mark.rclpy


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.0, math.pi, 3.1])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_odometry_is_placed_in_the_workspace(heading: float, scale: float) -> None:
    from nav_msgs.msg import Odometry

    from soter.adapters.velocity_controlled.motion import read_odometry

    message = Odometry()
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 500_000_000
    message.pose.pose.position.x, message.pose.pose.position.y = 1.0, 2.0
    message.pose.pose.orientation.z = scale * math.sin(heading / 2)
    message.pose.pose.orientation.w = scale * math.cos(heading / 2)
    message.twist.twist.linear.x, message.twist.twist.linear.y, message.twist.twist.angular.z = 0.2, 0.1, 0.5
    motion = read_odometry(message, (10.0, 20.0, math.pi / 2))
    assert motion.stamp_s == 12.5
    assert (motion.x_m, motion.y_m) == pytest.approx((8.0, 21.0))
    assert math.remainder(motion.heading_rad - heading - math.pi / 2, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert -math.pi < motion.heading_rad <= math.pi
    east, north = motion.velocity
    c, s = math.cos(motion.heading_rad), math.sin(motion.heading_rad)
    assert (east * c + north * s, north * c - east * s) == pytest.approx((0.2, 0.1))


@pytest.mark.parametrize("percentage", [math.nan, -0.1, 1.5])
def test_a_charge_that_is_none_is_not_read(percentage: float) -> None:
    from sensor_msgs.msg import BatteryState

    from soter.adapters.velocity_controlled.motion import read_battery

    message = BatteryState()
    message.percentage = percentage
    assert read_battery(message) is None


@pytest.mark.parametrize("stamped", [False, True])
def test_a_velocity(stamped: bool) -> None:
    from builtin_interfaces.msg import Time

    from soter.adapters.ros2.graph import make_velocity

    message = make_velocity(0.2, -0.5, Time(sec=7), stamped=stamped)
    twist = message.twist if stamped else message
    assert (twist.linear.x, twist.angular.z) == (0.2, -0.5)
    assert not stamped or message.header.stamp.sec == 7
