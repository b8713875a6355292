"""A world in real time as ROS 2 robots: their bases and its clock, on the ROS graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from soter.adapters.ros2.executor import GuardedNode, executor_in
from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.ros2.base import CLOCK, Base, to_ros
from soter_sim.velocity_controlled import START_S, VelocityControlledEndpoint


class Endpoint(VelocityControlledEndpoint):
    """The ROS 2 endpoint of a world.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        namespaces: by robot, the namespace of its topics.
        limits: what the mission promises.
        stamped: whether velocities come as TwistStamped.
        truth_port: port that serves the truth; 0 for any free one.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        namespaces: Mapping[int, str],
        limits: RuleLimits,
        *,
        stamped: bool = False,
        truth_port: int = 0,
    ) -> None:
        super().__init__(workspace, robots, limits, truth_port)
        self._context: Final = Context()
        rclpy.init(context=self._context)
        self._executor: Final = executor_in(self._context)
        self._nodes: Final = [self._node("soter_sim", None)]
        self._executor.add_node(self._nodes[0])
        self._clock: Final = self._nodes[0].create_publisher(Clock, "/clock", CLOCK)
        for robot in robots:
            node = self._node("base", namespaces[robot.id])
            self._nodes.append(node)
            self._executor.add_node(node)
            self.bases[robot.id] = Base(node, self.world, robot.id, stamped=stamped)

    def _wait(self, seconds: float) -> None:
        self._executor.spin_once(timeout_sec=seconds)

    def _tell(self, before: int, steps: int) -> None:
        self._clock.publish(Clock(clock=to_ros(START_S + self.world.now_s)))
        super()._tell(before, steps)

    def _end(self) -> None:
        super()._end()
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self._nodes.clear()
        self._context.try_shutdown()

    def _node(self, name: str, namespace: str | None) -> Node:
        return GuardedNode(
            name, context=self._context, namespace=namespace, use_global_arguments=False, start_parameter_services=False
        )
