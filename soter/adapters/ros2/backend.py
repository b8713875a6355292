"""The backend `ros2`: given robots of the ROS graph, or simulated ones that are started for the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import ClassVar, Final

from soter.adapters.ros2.options import Ros2Config, Ros2RobotOptions
from soter.adapters.ros2.robot import Ros2Robot
from soter.adapters.ros2.simulator import Ros2Simulator
from soter.adapters.velocity_controlled.options import promising
from soter.clock import VehicleClock
from soter.sdk import INTERFACE_VERSION, BackendConfig, Capabilities, Robot, RobotSpec
from soter.sdk.wire import WireBackend


class Ros2Backend(WireBackend):
    """Robots of the ROS graph, with one thread that receives their messages.

    Args:
        external_ac: whether the robots' ACs are nodes outside SOTER.
    """

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = Ros2Config
    robot_class: ClassVar[type[Robot]] = Ros2Robot
    harness: ClassVar[str] = "soter.adapters.ros2.harness:Ros2Harness"

    def __init__(self, *, external_ac: bool = False) -> None:
        self._external_ac: Final = external_ac

    @classmethod
    def promises(cls, config: Ros2Config) -> Capabilities:
        return config.promised()

    @classmethod
    def simulate(cls, config: Ros2Config, robots: Sequence[RobotSpec]) -> Ros2Simulator:
        return Ros2Simulator(
            config.workspace, robots, stamped=config.stamped, domain_id=config.domain_id, limits=config.limits
        )

    @classmethod
    def located(cls, config: Ros2Config, simulator: Ros2Simulator) -> Ros2Config:
        robots = {robot_id: Ros2RobotOptions(namespace=name) for robot_id, name in simulator.namespaces.items()}
        return config.model_copy(update={
            "robots": robots, "domain_id": simulator.domain_id, "truth": simulator.truth, "use_sim_time": True,
            "loopback": True,
        })  # fmt: skip

    def connect(
        self, config: Ros2Config, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Ros2Robot]:
        from soter.adapters.ros2.graph import Graph

        graph = Graph(config.domain_id, use_sim_time=config.use_sim_time, on_loopback=config.loopback)
        shared.callback(graph.close)
        return [
            Ros2Robot(promising(spec, config), clock, graph, config, external_ac=self._external_ac) for spec in robots
        ]
