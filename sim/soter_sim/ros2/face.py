"""A world in real time, its robots' bases, its clock and its truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from soter.sdk.values import RobotSpec
from soter.workspace import Workspace
from soter_sim.kinematic import KinematicEngine
from soter_sim.ros2.base import Base
from soter_sim.truth_server import TruthServer
from soter_sim.world import World

STEP_S: Final = 1.0 / 60.0
_ODOMETRY_STEPS: Final = 2
_BATTERY_STEPS: Final = 30

START_S: Final = 1000.0
"""What the world's clock shows at first, so that nobody can take its time for the host's or for none."""


class Face:
    """The ROS 2 face of a world.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        namespaces: by robot, where its topics are.
        stamped: whether velocities come as TwistStamped.
        truth_port: where to tell the truth; 0 for any port that is free.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        namespaces: Mapping[int, str],
        *,
        stamped: bool = False,
        truth_port: int = 0,
    ) -> None:
        def engine(_workspace: Workspace, _robots: Sequence[RobotSpec]) -> KinematicEngine:
            return KinematicEngine(_workspace, _robots, STEP_S)

        self.world: Final = World(workspace, robots, engine)
        self.truth: Final = TruthServer(self.world, truth_port)
        self._context: Final = Context()
        rclpy.init(context=self._context)
        self._executor: Final = SingleThreadedExecutor(context=self._context)
        self._nodes: Final = [self._node("soter_sim", None)]
        self._executor.add_node(self._nodes[0])
        self._clock: Final = self._nodes[0].create_publisher(
            Clock, "/clock", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        )
        self._bases: Final[list[Base]] = []
        for robot in robots:
            node = self._node("base", namespaces[robot.id])
            self._nodes.append(node)
            self._executor.add_node(node)
            self._bases.append(Base(node, self.world, robot.id, self._stamp, stamped=stamped))

    def run(self, stop: Callable[[], bool]) -> None:
        """Keep pace with the host's clock until told to stop.

        A host that was busy is caught up with: the world first lives through what it has missed, with the velocities
        that it had then.
        """
        world, began_s = self.world, time.perf_counter()
        steps = told = 0
        while not stop():
            due_s = began_s + (steps + 1) * STEP_S
            self._executor.spin_once(timeout_sec=max(0.0, due_s - time.perf_counter()))
            while began_s + (steps + 1) * STEP_S <= time.perf_counter():
                steps += 1
                world.advance(steps * STEP_S)
            if steps > told:
                self._tell(told, steps)
                told = steps

    def close(self) -> None:
        """End everything. Idempotent."""
        self.truth.close()
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self._nodes.clear()
        self._context.try_shutdown()
        self.world.close()

    def _tell(self, before: int, steps: int) -> None:
        """Publish what is due after so many steps, `before` of which were told already."""
        self._clock.publish(Clock(clock=self._stamp()))
        if steps // _ODOMETRY_STEPS > before // _ODOMETRY_STEPS:
            for base in self._bases:
                base.tell_odometry()
        if steps // _BATTERY_STEPS > before // _BATTERY_STEPS:
            for base in self._bases:
                base.tell_battery()
        self.truth.tell()

    def _stamp(self) -> Any:
        return Time(nanoseconds=round((START_S + self.world.now_s) * 1e9)).to_msg()

    def _node(self, name: str, namespace: str | None) -> Node:
        return Node(
            name, context=self._context, namespace=namespace, use_global_arguments=False, start_parameter_services=False
        )
