"""A bad link, for tests: a relay between SOTER and its robots on the ROS graph."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from soter.adapters.ros2.graph import COMMAND, LATCHED, SENSOR, Graph
from soter.conformance.impaired import ImpairedRelay, Line
from soter.onboard.wire import CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER

FAR: Final = "/far"
"""What stands before a robot's namespace on SOTER's side of the relay."""


class _Topic(NamedTuple):
    name: str
    kind: Any
    heard: QoSProfile
    said: QoSProfile
    to_robot: bool


_TOPICS: Final = (
    _Topic("odom", Odometry, SENSOR, COMMAND, to_robot=False),
    _Topic("battery_state", BatteryState, SENSOR, COMMAND, to_robot=False),
    _Topic(GATE, String, LATCHED, LATCHED, to_robot=False),
    _Topic(ORDER, String, LATCHED, LATCHED, to_robot=True),
    _Topic(CMD_VEL_AC, Twist, SENSOR, COMMAND, to_robot=True),
    _Topic(CMD_VEL_SC, Twist, SENSOR, COMMAND, to_robot=True),
)


class Relay(ImpairedRelay):
    """Passes messages on, both ways.

    Args:
        domain_id: of ROS.
        namespaces: by robot, where it really is; SOTER finds it under `FAR`.
    """

    def __init__(self, domain_id: int, namespaces: dict[int, str]) -> None:
        super().__init__()
        self._graph: Final = Graph(domain_id, use_sim_time=False, on_loopback=True)
        node = self._graph.node("/relay")
        for robot_id, namespace in namespaces.items():
            for topic in _TOPICS:
                self._connect(robot_id, node, namespace, topic)

    def close(self) -> None:
        super().close()
        self._graph.close()

    def _connect(self, robot_id: int, node: Any, namespace: str, topic: _Topic) -> None:
        real, far = f"{namespace}/{topic.name}", f"{FAR}{namespace}/{topic.name}"
        heard, said = (far, real) if topic.to_robot else (real, far)
        line = Line(robot_id, node.create_publisher(topic.kind, said, topic.said).publish)
        node.create_subscription(topic.kind, heard, lambda message: self.pass_on(line, message), topic.heard, raw=True)
