"""The mux: a node on the robot that lets one of two controllers drive it, and stops it when SOTER falls silent.

`soter ros2-mux --robot NAME`, `soter-ros2-mux` in launch files, or `python -m soter.adapters.ros2.mux`. It needs
rclpy, geometry_msgs, std_msgs and those modules of SOTER that use only the standard library; nothing else.

It passes `cmd_vel_ac` or `cmd_vel_sc` on to `cmd_vel`, by the latest `soter/order`, and reports its state on
`soter/gate`. While the lease is dead, or the active controller is silent, it publishes rest. Topics are relative to the
robot's namespace and take ROS's own remappings; parameters are read once, at the start: `lease_s`, `command_s`,
`v_max_m_s`, `yaw_rate_max_rad_s`, `stamped` (TwistStamped instead of Twist) and ROS's `use_sim_time`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, Final

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from soter.adapters.ros2.executor import GuardedNode, executor_in, spin
from soter.onboard.gate_node import COMMAND_S, LEASE_S, PERIOD_S, V_MAX_M_S, YAW_RATE_MAX_RAD_S, GateNode
from soter.onboard.program import LEAVE_S, Ending, favour, killed_after
from soter.onboard.velocity import REST, Velocity, VelocityGate
from soter.onboard.wire import AC, CMD_VEL, CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER, SC

# Matches publishers of either kind: a controller has sent a newer velocity before a repeated one arrives.
_STREAM: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_LATCHED: Final = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class MuxNode(GuardedNode):
    """The gate of one robot as a ROS node. Used only in its executor's thread.

    Args:
        namespace: the robot's namespace; empty for that of ROS's own arguments.
        options: for `rclpy.node.Node`.
    """

    def __init__(self, namespace: str = "", **options: Any) -> None:
        super().__init__("soter_mux", namespace=namespace or None, start_parameter_services=False, **options)
        number = self._number
        gate = VelocityGate(
            number("lease_s", LEASE_S), number("command_s", COMMAND_S), number("v_max_m_s", V_MAX_M_S),
            number("yaw_rate_max_rad_s", YAW_RATE_MAX_RAD_S),
        )  # fmt: skip
        self._stamped: Final = bool(self.declare_parameter("stamped", False).value)
        kind = TwistStamped if self._stamped else Twist
        self._velocities: Final = self.create_publisher(kind, CMD_VEL, 1)
        self._reports: Final = self.create_publisher(String, GATE, _LATCHED)
        self._gate: Final = _RosGateNode(gate, self)
        self.create_subscription(String, ORDER, lambda message: self._gate.hear_order(message.data), _LATCHED)
        self.create_subscription(kind, CMD_VEL_AC, lambda message: self._hear(AC, message), _STREAM)
        self.create_subscription(kind, CMD_VEL_SC, lambda message: self._hear(SC, message), _STREAM)
        # Not ROS time: if that stands still, the robot must still stop.
        self.create_timer(PERIOD_S, self._gate.look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._gate.report()

    def pass_on(self, velocity: Velocity) -> None:
        """Publish a velocity for the base."""
        message: Any = TwistStamped() if self._stamped else Twist()
        twist = message.twist if self._stamped else message
        twist.linear.x, twist.angular.z = velocity
        if self._stamped:
            message.header.stamp = self.get_clock().now().to_msg()
        self._velocities.publish(message)

    def say(self, report: str) -> None:
        """Publish a report of the gate."""
        self._reports.publish(String(data=report))

    def _number(self, name: str, default: float) -> float:
        # Of any type: "1" is an integer to ROS, which it refuses for a parameter declared as a float.
        value = self.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
            raise ValueError(f"parameter {name} is {value!r}, allowed: above 0")
        return float(value)

    def _hear(self, by: str, message: Any) -> None:
        twist = message.twist if self._stamped else message
        self._gate.hear(by, Velocity(twist.linear.x, twist.angular.z))


class _RosGateNode(GateNode):
    """Connects the gate with a ROS node."""

    def __init__(self, gate: VelocityGate, node: MuxNode) -> None:
        super().__init__(gate)
        self._node: Final = node

    def _clock_s(self) -> float | None:
        clock_s = float(self._node.get_clock().now().nanoseconds * 1e-9)
        # Simulated time is 0 until /clock is heard.
        return clock_s if clock_s > 0.0 else None

    def _pass_on(self, velocity: Velocity) -> None:
        self._node.pass_on(velocity)

    def _say(self, report: str) -> None:
        self._node.say(report)

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the mux until it is interrupted or, with `--parent PID`, until that process is gone."""
    parser = argparse.ArgumentParser(
        prog="soter-ros2-mux", description="Lets SOTER's AC or SC drive a robot, and stops it when SOTER is silent.",
        epilog="Everything after --ros-args is ROS's own: remappings, parameters, log levels.",
    )  # fmt: skip
    parser.add_argument("--robot", default="", metavar="NAME", help="the robot's namespace, such as robot1")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    given = list(sys.argv[1:] if arguments is None else arguments)
    cut = given.index("--ros-args") if "--ros-args" in given else len(given)
    known = parser.parse_args(given[:cut])
    # Our own signal handlers: after rclpy's handlers have run, nothing can be published any more.
    rclpy.init(args=given[cut:], signal_handler_options=SignalHandlerOptions.NO)
    ended = Ending(known.parent)
    try:
        node = MuxNode(known.robot)
    except (ValueError, ParameterException) as failure:
        rclpy.try_shutdown()
        parser.error(str(failure))
    executor = executor_in(node.context)
    executor.add_node(node)
    if known.parent is None:
        heard = ", ".join(each.topic_name for each in node.subscriptions)
        node.get_logger().info(
            f"connected in ROS domain {node.context.get_domain_id()}, listening to {heard}; Ctrl-C ends it"
        )
    favour()
    try:
        spin(executor, ended)
    finally:
        if rclpy.ok():
            node.pass_on(REST)
        with killed_after(LEAVE_S):
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()


if __name__ == "__main__":
    main()
