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
from soter.conformance import Harness, driver
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


class Ros2Harness(Harness):
    """Opens simulated robots behind a relay, in a ROS domain of their own, for every fleet anew."""

    name = "ros2"
    room_m = 2.4
    connect_timeout_s = 20.0

    def __init__(self) -> None:
        self._fleet: Fleet | None = None
        self._simulator: Simulator | None = None
        self._relay: Relay | None = None
        self._witness: StreamedTruth | None = None
        self._drivers: list[subprocess.Popen[bytes]] = []

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        self._relay = Relay(simulator.domain_id, simulator.namespaces)
        self._fleet = _fleet(simulator.domain_id, simulator.truth, FAR, simulator.namespaces)
        return self._fleet

    def close(self) -> None:
        for process in self._drivers:
            process.kill()
            process.wait()
        self._drivers.clear()
        relay = self._relay
        if relay is not None:
            relay.cut, relay.delay_s, relay.loss = frozenset(), 0.0, 0.0
        if self._fleet is not None:
            self._fleet.close()
        for each in (relay, self._witness, self._simulator):
            if each is not None:
                each.close()
        self._fleet = self._relay = self._witness = self._simulator = None

    # --- faults on the wire --------------------------------------------------------------------------------

    def cut(self, robot_id: int) -> None:
        self._link().cut |= {robot_id}

    def restore(self, robot_id: int) -> None:
        self._link().cut -= {robot_id}

    def delay(self, seconds: float) -> None:
        self._link().delay_s = seconds

    def loss(self, fraction: float) -> None:
        self._link().loss = fraction

    def duplicate(self, fraction: float) -> None:
        self._link().duplicate = fraction

    def reorder(self, fraction: float) -> None:
        self._link().reorder = fraction

    # --- when the other side dies or hangs -----------------------------------------------------------------

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        argument = json.dumps([simulator.domain_id, simulator.truth, simulator.namespaces[1]])
        process = driver.spawn(f"{__name__}:open_given", argument, target)
        self._drivers.append(process)
        return process

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        assert self._witness is not None
        return self._witness.pose(robot_id)

    def _start(self, robots: int) -> Simulator:
        self._simulator = simulator = Simulator(_ROOM, _specs(robots))
        self._witness = StreamedTruth(simulator.truth, VehicleClock())
        return simulator

    def _link(self) -> Relay:
        assert self._relay is not None
        return self._relay


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
