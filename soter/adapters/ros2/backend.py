"""The backend `ros2`: robots of the ROS graph, those that are given or simulated ones that are started for the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import ClassVar

from soter.adapters.ros2.options import RobotOptions, Ros2Config
from soter.adapters.ros2.robot import Ros2Robot
from soter.adapters.ros2.simulator import Simulator
from soter.adapters.velocity_controlled.options import promising, require_places
from soter.adapters.velocity_controlled.simulator import StreamedFleet
from soter.clock import VehicleClock
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Capabilities, Robot, RobotSpec


class Ros2Fleet(StreamedFleet[Ros2Robot, Simulator]):
    """Robots, one thread that hears them, and the simulator if it was started for them.

    Args:
        config: where the robots are.
        specs: the robots.
        simulator: a simulator to end with the fleet, or None.
        external_ac: the robots' ACs are somebody else's nodes.
    """

    def __init__(
        self,
        config: Ros2Config,
        specs: Sequence[RobotSpec],
        simulator: Simulator | None,
        *,
        external_ac: bool = False,
    ) -> None:
        from soter.adapters.ros2.graph import Graph

        clock = VehicleClock()

        def make(stack: ExitStack) -> Sequence[Ros2Robot]:
            graph = Graph(config.domain_id, use_sim_time=config.use_sim_time, on_loopback=config.loopback)
            stack.callback(graph.close)
            return [Ros2Robot(promising(spec, config), clock, graph, config, external_ac=external_ac) for spec in specs]

        super().__init__(clock, config.truth, simulator, make)


class Ros2Backend(Backend):
    """Robots of the ROS graph: those that are given, or simulated ones that are started for the occasion."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = Ros2Config
    robot_class: ClassVar[type[Robot]] = Ros2Robot
    harness: ClassVar[str] = "soter.adapters.ros2.harness:Ros2Harness"

    @classmethod
    def promises(cls, config: Ros2Config) -> Capabilities:
        return config.promised()

    def open(self, config: Ros2Config, robots: Sequence[RobotSpec]) -> Ros2Fleet:
        """Open the robots; they are not ready before `init()`.

        Raises:
            RobotUnavailable: a robot is not given, or the simulated ones do not start.
        """
        if config.robots:
            require_places(config.robots, robots, "backends.ros2.robots")
            return Ros2Fleet(config, robots, None)
        simulator = Simulator(
            config.workspace, robots, stamped=config.stamped, domain_id=config.domain_id, limits=config.limits
        )
        try:
            return Ros2Fleet(simulated(config, simulator), robots, simulator)
        except BaseException:
            simulator.close()
            raise


def simulated(config: Ros2Config, simulator: Simulator) -> Ros2Config:
    """Return a configuration with the robots of a simulator in it."""
    robots = {robot_id: RobotOptions(namespace=name) for robot_id, name in simulator.namespaces.items()}
    return config.model_copy(
        update={
            "robots": robots,
            "domain_id": simulator.domain_id,
            "truth": simulator.truth,
            "use_sim_time": True,
            "loopback": True,
        }
    )
