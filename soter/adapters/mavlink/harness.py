"""What the conformance kit needs to judge the MAVLink adapters: fresh vehicles, and ways to break the link to them.

`soter conform mavlink` judges the rover. The other harnesses are given by name, as in
`soter conform soter.adapters.mavlink.harness:CopterHarness`.
"""

from __future__ import annotations

import json
import subprocess
from typing import Any, ClassVar, Final

from soter.adapters.mavlink.backend import MavlinkBackend, MavlinkFleet, VehicleBackend
from soter.adapters.mavlink.mavsdk_backend import MavsdkBackend
from soter.adapters.mavlink.options import STREAM_HZ, MavlinkConfig
from soter.adapters.mavlink.relay import Relay
from soter.adapters.mavlink.simulator import Simulator, describe, free_port
from soter.clock import VehicleClock
from soter.conformance import WIDE_ROOMS, RelayedHarness, in_wide_rooms
from soter.sdk import Fleet, Waypoint
from soter.sdk.truth import StreamedTruth


class MavlinkHarness(RelayedHarness):
    """Opens simulated rovers behind a relay, for every fleet anew.

    Attributes:
        backend: what is judged.
        options: of the backend.
        simulator_options: more arguments for the simulated vehicles.
    """

    name = "mavlink"
    room_m = 2.4
    side_by_side = True
    connect_timeout_s = 30.0
    backend: ClassVar[type[VehicleBackend]] = MavlinkBackend
    options: ClassVar[dict[str, Any]] = {}
    simulator_options: ClassVar[tuple[str, ...]] = ()

    def open(self, robots: int) -> Fleet:
        port = free_port()
        self.relay = relay = Relay(port)
        simulator = self._start(robots, relay.port)
        self.fleet = self._opened(port, simulator.truth, robots)
        return self.fleet

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        port = free_port()
        simulator = self._start(1, port)
        self.witness = StreamedTruth(simulator.truth, VehicleClock())
        harness = f"{type(self).__module__}:{type(self).__qualname__}"
        argument = json.dumps({"harness": harness, "port": port, "truth": simulator.truth})
        return self.driven(f"{__name__}:open_given", argument, target)

    def _start(self, robots: int, port: int) -> Simulator:
        rate_hz = self.options.get("stream_hz", STREAM_HZ)
        options = ("--vehicle", self.options.get("vehicle", "rover"), "--rate", str(rate_hz), *self.simulator_options)
        self.simulator = simulator = Simulator(describe(WIDE_ROOMS, in_wide_rooms(robots)), port, *options)
        return simulator

    def _opened(self, port: int, truth: str, robots: int) -> MavlinkFleet:
        config = MavlinkConfig.model_validate(
            {"workspace": WIDE_ROOMS, "connection": f"udpin:127.0.0.1:{port}", "truth": truth, **self.options}
        )
        return self.backend().open(config, in_wide_rooms(robots))


class CopterHarness(MavlinkHarness):
    """Opens simulated copters."""

    name = "mavlink (copter)"
    options: ClassVar[dict[str, Any]] = {"vehicle": "copter"}


class PlainHarness(MavlinkHarness):
    """Opens simulated rovers without anything that real autopilots lack: no gate, no lease."""

    name = "mavlink (plain rover)"
    simulator_options: ClassVar[tuple[str, ...]] = ("--plain",)


class MavsdkHarness(MavlinkHarness):
    """Opens simulated rovers for the backend `mavsdk`."""

    name = "mavsdk"
    backend: ClassVar[type[VehicleBackend]] = MavsdkBackend


class MavsdkCopterHarness(MavsdkHarness):
    """Opens simulated copters for the backend `mavsdk`."""

    name = "mavsdk (copter)"
    options: ClassVar[dict[str, Any]] = {"vehicle": "copter"}


def open_given(argument: str) -> Fleet:
    """Return robot 1 at a port that comes as JSON; what the kit's driver process calls."""
    given = json.loads(argument)
    harness = HARNESSES[given["harness"].rpartition(":")[2]]()
    return harness._opened(given["port"], given["truth"], 1)


HARNESSES: Final = {
    each.__name__: each for each in (MavlinkHarness, CopterHarness, PlainHarness, MavsdkHarness, MavsdkCopterHarness)
}
