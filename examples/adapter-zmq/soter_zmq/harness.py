"""What SOTER's conformance kit needs to judge this adapter: fresh robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess
from typing import Any, Final

import zmq

from soter.clock import VehicleClock
from soter.conformance import RelayedHarness
from soter.sdk import Fleet, RobotSpec, Waypoint
from soter.workspace import Box, RobotPlace, Workspace
from soter_zmq.adapter import ZmqConfig, ZmqFleet
from soter_zmq.receiver import Receiver, StreamedTruth
from soter_zmq.relay import Relay
from soter_zmq.simulator import Simulator, describe

_ROOM: Final = Workspace(
    10.0, 8.0, (),
    (
        RobotPlace(1, 2.5, 3.5, Box(2.3, 3.3, 2.7, 3.7), 0.7),
        RobotPlace(2, 6.5, 4.2, Box(6.3, 4.0, 6.7, 4.4), -2.1),
    ),
)  # fmt: skip


class ZmqHarness(RelayedHarness):
    """Opens simulated robots behind a relay, for every fleet anew."""

    name = "zmq"
    room_m = 2.4

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        self.relay = relay = Relay(simulator.endpoints)
        self.fleet = _fleet(relay.endpoints, simulator.truth, robots)
        return self.fleet

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        argument = json.dumps({"robots": simulator.endpoints, "truth": simulator.truth})
        return self.driven(f"{__name__}:open_given", argument, target)

    def _start(self, robots: int) -> Simulator:
        self.simulator = simulator = Simulator(describe(_ROOM, _specs(robots)))
        self.witness = _Witness(simulator.truth)
        return simulator


def open_given(argument: str) -> Fleet:
    """Return robot 1 at addresses that come as JSON; what the kit's driver process calls."""
    given = json.loads(argument)
    return _fleet(given["robots"], given["truth"], 1)


class _Witness:
    """Hears what really happens, beside the adapter."""

    def __init__(self, address: str) -> None:
        clock = VehicleClock()
        self.truth: Final = StreamedTruth(clock)
        self._context: Final = zmq.Context()
        self._context.linger = 0
        self._receiver: Final = Receiver(self._context, clock, {address: self.truth.hear})
        self._receiver.wait_for(lambda: self.truth.known, 5.0)

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        return self.truth.pose(robot_id)

    def close(self) -> None:
        self._receiver.close()
        self._context.destroy()


def _specs(robots: int) -> list[RobotSpec]:
    return [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad, 0.8) for place in _ROOM.robots[:robots]]


def _fleet(robots: Any, truth: str, count: int) -> Fleet:
    config = ZmqConfig.model_validate({"workspace": _ROOM, "robots": robots, "truth": truth})
    return ZmqFleet(config, _specs(count), None)
