"""One ROS 2 robot behind the narrow interface."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from soter.adapters.ros2.options import Ros2Config
from soter.adapters.velocity_controlled.robot import SETTLED, VelocityControlledRobot, wait_for
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.onboard.wire import AC, SC
from soter.sdk import Capabilities, RobotSpec

if TYPE_CHECKING:
    # Imported where it is used, so that promises can be read without ROS.
    from soter.adapters.ros2.graph import Graph

_MUX: Final = "soter_mux"
_WATCH_S: Final = 0.08
"""Period of the check for other publishers that could move the robot; shorter than the time that one counts."""

_NAMELESS_S: Final = 3.0
"""A node's name is known at most this long after the node, unless the node hides it."""


class Ros2Robot(VelocityControlledRobot):
    """One robot in a namespace of the ROS graph. It receives and steers in the graph's thread.

    Args:
        spec: the robot.
        clock: follows the robots' clocks.
        ros: SOTER's part of the graph.
        config: the backend's options, with this robot in it.
        external_ac: whether the AC is a node outside SOTER; then SOTER never publishes on `cmd_vel_ac`.
    """

    def __init__(
        self, spec: RobotSpec, clock: VehicleClock, ros: Graph, config: Ros2Config, *, external_ac: bool = False
    ) -> None:
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import BatteryState
        from std_msgs.msg import String

        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.graph import velocity_type

        place, topics = config.robots[spec.id], config.topics
        super().__init__(spec, clock, place.odom_origin, external_ac=external_ac)
        self._config: Final = config
        self.node: Final = ros.node(place.namespace)
        node, velocity = self.node, velocity_type(stamped=config.stamped)
        self._velocities: Final = {SC: node.create_publisher(velocity, topics.cmd_vel_sc, graph.COMMAND)}
        if not external_ac:
            self._velocities[AC] = node.create_publisher(velocity, topics.cmd_vel_ac, graph.COMMAND)
        self._orders: Final = node.create_publisher(String, topics.order, graph.LATCHED)
        node.create_subscription(String, topics.gate, lambda message: self._take_report(message.data), graph.LATCHED)
        if topics.battery:
            node.create_subscription(BatteryState, topics.battery, self._take_battery, graph.SENSOR)
        node.create_subscription(Odometry, topics.odom, self._take_odometry, graph.SENSOR)

    def _send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float) -> None:
        from soter.adapters.ros2.graph import make_velocity

        stamped = self._config.stamped
        stamp: Any = self.node.get_clock().now().to_msg() if stamped else None
        self._velocities[by].publish(make_velocity(forward_m_s, turn_rad_s, stamp, stamped=stamped))

    def _send_order(self, text: str) -> None:
        from std_msgs.msg import String

        self._orders.publish(String(data=text))

    def _connect(self, timeout_s: float) -> Capabilities:
        clock = self.clock
        until_s = clock.steady_s() + timeout_s
        battery = bool(self._config.topics.battery)
        if not self._discover(min(timeout_s, self._config.discovery_s), battery=battery):
            raise RobotUnavailable(f"robot {self.id} at {self.node.get_namespace()}: {self._missing()}")
        self._refuse_others(until_s - clock.steady_s())
        if not self._settle(until_s - clock.steady_s()):
            why = self._refusal() or (
                f"its mux takes no order; does it hear {self._config.topics.order}, and use_sim_time as the robot does?"
            )
            raise RobotUnavailable(f"robot {self.id} at {self.node.get_namespace()}: {why}")
        self._watch()
        return replace(self.declared, reports_battery=battery)

    def _missing(self) -> str:
        """Return which messages were not heard, and likely causes."""
        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.graph import KINDS

        config, node = self._config, self.node
        topics, missing = config.topics, []
        if self._heard < SETTLED:
            missing += graph.heard_wrongly(node, topics.odom, "nav_msgs/msg/Odometry", graph.SENSOR) or [
                f"{self._heard} messages were heard on {topics.odom}"
            ]
        if self._charge is None and topics.battery:
            missing += graph.heard_wrongly(node, topics.battery, "sensor_msgs/msg/BatteryState", graph.SENSOR) or [
                f"no charge from 0 to 1 was heard on {topics.battery}"
            ]
        if self._gate is None:
            missing += graph.heard_wrongly(node, topics.gate, "std_msgs/msg/String", graph.LATCHED) or [
                f"nothing was heard on {topics.gate}"
            ]
            missing += graph.said_wrongly(node, topics.cmd_vel_sc, KINDS[config.stamped], graph.COMMAND)
        if config.use_sim_time and not graph.publishers(node, "/clock"):
            missing.append("/clock has no publisher, and use_sim_time is set")
        return (
            f"within {config.discovery_s:g} s: {'; '.join(missing)}. Is the robot running, with `soter ros2-mux` "
            "beside it, and are the namespace, the topics and the ROS domain in [backends.ros2] right?"
        )

    def _watch(self) -> None:
        """Check at intervals, in the receiving thread, for other nodes that may move the robot."""
        from rclpy.clock import Clock, ClockType

        from soter.adapters.ros2 import graph

        named_s = self.clock.steady_s()

        def look() -> None:
            nonlocal named_s
            now_s, topics = self.clock.steady_s(), self._config.topics
            if graph.all_named(self.node, topics.cmd_vel, topics.cmd_vel_sc):
                named_s = now_s
            # A node is found before its name; one that stays nameless for long counts as an intruder.
            found = self._others(nameless=now_s - named_s > _NAMELESS_S)
            if found:
                self._take_intruder(found)

        self.node.create_timer(_WATCH_S, look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _others(self, *, nameless: bool = True) -> str:
        """Return, in words, the nodes that may drive the robot past the mux or as the SC; empty without any.

        Args:
            nameless: whether nodes count whose names are not known.
        """
        from soter.adapters.ros2 import graph

        node, topics = self.node, self._config.topics
        own = f"{node.get_namespace().rstrip('/')}/{graph.NODE_NAME}"
        past = [name for name in graph.publishers(node, topics.cmd_vel, nameless) if not name.endswith(f"/{_MUX}")]
        forged = [name for name in graph.publishers(node, topics.cmd_vel_sc, nameless) if name != own]
        for names, topic, what in (
            (past, topics.cmd_vel, "drive it past the mux"),
            (forged, topics.cmd_vel_sc, "speak for its safe controller"),
        ):
            if names:
                return f"{', '.join(names)} publish on {topic} and may {what}; let them publish on {topics.cmd_vel_ac}"
        return ""

    def _refuse_others(self, timeout_s: float) -> None:
        """Refuse a robot that other nodes may drive past the mux, or as the SC."""
        from soter.adapters.ros2 import graph
        from soter.adapters.ros2.graph import KINDS

        node, topics = self.node, self._config.topics
        wait_for(lambda: graph.all_named(node, topics.cmd_vel, topics.cmd_vel_sc), timeout_s)
        found = self._others()
        if found:
            raise RobotUnavailable(f"robot {self.id} at {node.get_namespace()}: {found}")
        wrong = graph.said_wrongly(node, topics.cmd_vel_sc, KINDS[self._config.stamped], graph.COMMAND)
        if wrong:
            raise RobotUnavailable(f"robot {self.id} at {node.get_namespace()}: {'; '.join(wrong)}")
