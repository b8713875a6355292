"""What SOTER's conformance kit needs to judge this adapter: fresh robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess
from typing import Any, Final

import zmq

from soter.clock import VehicleClock
from soter.conformance import WIDE_ROOMS, RelayedHarness, in_wide_rooms
from soter.sdk import Fleet, Waypoint
from soter.sdk.truth import ToldTruth
from soter_zmq.adapter import ZmqConfig, ZmqFleet
from soter_zmq.receiver import Receiver
from soter_zmq.relay import Relay
from soter_zmq.simulator import Simulator, describe


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
        self.simulator = simulator = Simulator(describe(WIDE_ROOMS, in_wide_rooms(robots)))
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
        self.truth: Final = ToldTruth(clock)
        self._context: Final = zmq.Context()
        self._context.linger = 0
        self._receiver: Final = Receiver(self._context, clock, {address: lambda message, _: self.truth.hear(message)})
        self._receiver.wait_for(lambda: self.truth.known, 5.0)

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        return self.truth.pose(robot_id)

    def close(self) -> None:
        self._receiver.close()
        self._context.destroy()


def _fleet(robots: Any, truth: str, count: int) -> Fleet:
    config = ZmqConfig.model_validate({"workspace": WIDE_ROOMS, "robots": robots, "truth": truth})
    return ZmqFleet(config, in_wide_rooms(count), None)
