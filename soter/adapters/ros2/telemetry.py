"""Publishes SOTER's decisions as standard ROS messages, for `ros2 topic echo`, rqt and PlotJuggler."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, String

from soter.adapters.ros2.graph import LATCHED
from soter.adapters.ros2.robot import Ros2Robot
from soter.onboard.wire import AC, SC

_PERIOD_TICKS: Final = 20
_KEPT: Final = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Telemetry:
    """Publishes each robot's decisions in its namespace, from the robot's own node.

    | topic | type | when |
    |---|---|---|
    | `soter/mode` | std_msgs/String, latched | "AC" or "SC", when it changes |
    | `soter/driver` | std_msgs/String, latched | "AC" or the safety module that drives, when it changes |
    | `soter/margin/MODULE` | std_msgs/Float64 | at every tick, in the module's unit, 0 is the edge of phi_safe |
    | `soter/disengagements` | diagnostic_msgs/DiagnosticArray, latched | at every switch, the last 100 |
    | `/diagnostics` | diagnostic_msgs/DiagnosticArray | every second: mode, cause, margins |

    Used from the supervisor's thread.
    """

    def __init__(self, robots: Sequence[Ros2Robot], modules: Sequence[str]) -> None:
        self._robots: Final = {robot.id: _Topics(robot.node, modules) for robot in robots}

    def tick(self, robot_id: int, driver: str, cause: str, margins: Mapping[str, float]) -> None:
        """Publish the decision on a robot in this tick."""
        self._robots[robot_id].tick(driver, cause, margins)

    def switched(self, robot_id: int, before: str, after: str, module: str, cause: str) -> None:
        """Publish a switch of a robot's active controller."""
        self._robots[robot_id].switched(before, after, module, cause)


class _Topics:
    def __init__(self, node: Node, modules: Sequence[str]) -> None:
        self._node: Final = node
        self._name: Final = f"soter: {node.get_namespace().strip('/')}"
        self._mode: Final = node.create_publisher(String, "soter/mode", LATCHED)
        self._driver: Final = node.create_publisher(String, "soter/driver", LATCHED)
        self._margins: Final = {each: node.create_publisher(Float64, f"soter/margin/{each}", 1) for each in modules}
        self._disengagements: Final = node.create_publisher(DiagnosticArray, "soter/disengagements", _KEPT)
        self._diagnostics: Final = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._told = ""
        self._ticks = 0

    def tick(self, driver: str, cause: str, margins: Mapping[str, float]) -> None:
        for name, margin in margins.items():
            # A module that has not judged yet has no margin.
            if math.isfinite(margin):
                self._margins[name].publish(Float64(data=margin))
        if driver != self._told:
            self._told = driver
            self._driver.publish(String(data=driver))
            self._mode.publish(String(data=AC if driver == AC else SC))
        if self._ticks % _PERIOD_TICKS == 0:
            values = {"driver": driver} | {f"margin {name}": f"{margin:.3f}" for name, margin in margins.items()}
            self._diagnostics.publish(self._array(driver == AC, cause or "the AC drives", values))
        self._ticks += 1

    def switched(self, before: str, after: str, module: str, cause: str) -> None:
        values = {"before": before, "after": after, "module": module, "cause": cause}
        self._disengagements.publish(self._array(after == AC, f"{before} -> {after}: {cause}", values))

    def _array(self, good: bool, message: str, values: Mapping[str, str]) -> Any:
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if good else DiagnosticStatus.WARN, name=self._name, message=message,
            hardware_id=self._node.get_namespace(),
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )  # fmt: skip
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        return array
