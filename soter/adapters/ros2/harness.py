"""What the conformance kit needs to judge this adapter: fresh simulated robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess

from soter.adapters.ros2.backend import Ros2Fleet
from soter.adapters.ros2.options import RobotOptions, Ros2Config
from soter.adapters.ros2.relay import FAR, Relay
from soter.adapters.ros2.simulator import Simulator
from soter.clock import VehicleClock
from soter.conformance import WIDE_ROOMS, RelayedHarness, in_wide_rooms
from soter.sdk import Fleet, Waypoint
from soter.sdk.truth import StreamedTruth


class Ros2Harness(RelayedHarness):
    """Opens simulated robots behind a relay, in a ROS domain of their own, for every fleet anew."""

    name = "ros2"
    room_m = 2.4
    side_by_side = True
    connect_timeout_s = 20.0

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        self.relay = Relay(simulator.domain_id, simulator.namespaces)
        self._seen_by_soter = simulator.domain_id, simulator.truth, FAR, simulator.namespaces
        self.fleet = self.second()
        return self.fleet

    def second(self) -> Fleet:
        return _fleet(*self._seen_by_soter)

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        argument = json.dumps([simulator.domain_id, simulator.truth, simulator.namespaces[1]])
        return self.driven(f"{__name__}:open_given", argument, target)

    def _start(self, robots: int) -> Simulator:
        self.simulator = simulator = Simulator(WIDE_ROOMS, in_wide_rooms(robots))
        self.witness = StreamedTruth(simulator.truth, VehicleClock())
        return simulator


def open_given(argument: str) -> Fleet:
    """Return robot 1, where it is as JSON; what the kit's driver process calls."""
    domain_id, truth, namespace = json.loads(argument)
    return _fleet(domain_id, truth, "", {1: namespace})


def _fleet(domain_id: int, truth: str, before: str, namespaces: dict[int, str]) -> Fleet:
    config = Ros2Config(
        workspace=WIDE_ROOMS,
        robots={robot_id: RobotOptions(namespace=before + name) for robot_id, name in namespaces.items()},
        domain_id=domain_id,
        truth=truth,
        use_sim_time=True,
        loopback=True,
    )
    return Ros2Fleet(config, in_wide_rooms(len(namespaces)), None)
