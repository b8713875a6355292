"""What the conformance kit needs to judge this adapter: fresh simulated robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess
from typing import Final

from soter.adapters.ros2.backend import Ros2Fleet
from soter.adapters.ros2.options import RobotOptions, Ros2Config
from soter.adapters.ros2.relay import FAR, Relay
from soter.adapters.ros2.simulator import Simulator
from soter.clock import VehicleClock
from soter.conformance import RelayedHarness
from soter.sdk import Fleet, RobotSpec, Waypoint
from soter.sdk.truth import StreamedTruth
from soter.workspace import Box, RobotPlace, Workspace

_ROOM: Final = Workspace(
    10.0, 8.0, (),
    (
        RobotPlace(1, 2.5, 3.5, Box(2.3, 3.3, 2.7, 3.7), 0.7),
        RobotPlace(2, 6.5, 4.2, Box(6.3, 4.0, 6.7, 4.4), -2.1),
    ),
)  # fmt: skip


class Ros2Harness(RelayedHarness):
    """Opens simulated robots behind a relay, in a ROS domain of their own, for every fleet anew."""

    name = "ros2"
    room_m = 2.4
    connect_timeout_s = 20.0

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        self.relay = Relay(simulator.domain_id, simulator.namespaces)
        self.fleet = _fleet(simulator.domain_id, simulator.truth, FAR, simulator.namespaces)
        return self.fleet

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        argument = json.dumps([simulator.domain_id, simulator.truth, simulator.namespaces[1]])
        return self.driven(f"{__name__}:open_given", argument, target)

    def _start(self, robots: int) -> Simulator:
        self.simulator = simulator = Simulator(_ROOM, _specs(robots))
        self.witness = StreamedTruth(simulator.truth, VehicleClock())
        return simulator


def open_given(argument: str) -> Fleet:
    """Return robot 1, where it is as JSON; what the kit's driver process calls."""
    domain_id, truth, namespace = json.loads(argument)
    return _fleet(domain_id, truth, "", {1: namespace})


def _specs(robots: int) -> list[RobotSpec]:
    return [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad, 0.8) for place in _ROOM.robots[:robots]]


def _fleet(domain_id: int, truth: str, before: str, namespaces: dict[int, str]) -> Fleet:
    config = Ros2Config(
        workspace=_ROOM,
        robots={robot_id: RobotOptions(namespace=before + name) for robot_id, name in namespaces.items()},
        domain_id=domain_id,
        truth=truth,
        use_sim_time=True,
        loopback=True,
    )
    return Ros2Fleet(config, _specs(len(namespaces)), None)
