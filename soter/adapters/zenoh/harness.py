"""What the conformance kit needs to judge this adapter: fresh simulated robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess
from typing import Final

from soter.adapters.zenoh.backend import ZenohFleet
from soter.adapters.zenoh.options import RobotOptions, ZenohConfig
from soter.adapters.zenoh.relay import Relay
from soter.adapters.zenoh.session import SessionOptions, endpoints
from soter.adapters.zenoh.simulator import Simulator
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


class ZenohHarness(RelayedHarness):
    """Opens simulated robots behind a relay, for every fleet anew; all of them are peers."""

    name = "zenoh"
    room_m = 2.4

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        relay = Relay(simulator.session, SessionOptions(), simulator.namespaces)
        self.relay = relay
        here = SessionOptions(connect=tuple(endpoints(relay.session)))
        self.fleet = _fleet(here, simulator.truth, simulator.namespaces)
        return self.fleet

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        config = _config(simulator.session, simulator.truth, {1: simulator.namespaces[1]})
        return self.driven(f"{__name__}:open_given", config.model_dump_json(exclude={"workspace"}), target)

    def _start(self, robots: int) -> Simulator:
        self.simulator = simulator = Simulator(_ROOM, _specs(robots))
        self.witness = StreamedTruth(simulator.truth, VehicleClock())
        return simulator


def open_given(argument: str) -> Fleet:
    """Return robot 1, where it is as JSON; what the kit's driver process calls."""
    config = ZenohConfig.model_validate({**json.loads(argument), "workspace": _ROOM})
    return ZenohFleet(config, _specs(1), None)


def _specs(robots: int) -> list[RobotSpec]:
    return [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad, 0.8) for place in _ROOM.robots[:robots]]


def _config(session: SessionOptions, truth: str, namespaces: dict[int, str]) -> ZenohConfig:
    robots = {robot_id: RobotOptions(namespace=name) for robot_id, name in namespaces.items()}
    return ZenohConfig(workspace=_ROOM, robots=robots, session=session, truth=truth)


def _fleet(session: SessionOptions, truth: str, namespaces: dict[int, str]) -> Fleet:
    return ZenohFleet(_config(session, truth, namespaces), _specs(len(namespaces)), None)
