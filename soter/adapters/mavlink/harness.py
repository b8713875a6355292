"""Harnesses of the conformance kit for the MAVLink adapters: fresh vehicles, and ways to break the link to them.

`soter conform mavlink` judges the rover. The other harnesses are given by name, as in
`soter conform soter.adapters.mavlink.harness:CopterHarness`.
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import threading
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from typing import Any, ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.backend import MavlinkBackend, MavlinkFleet, VehicleBackend
from soter.adapters.mavlink.mavsdk_backend import MavsdkBackend
from soter.adapters.mavlink.options import STREAM_HZ, MavlinkConfig
from soter.adapters.mavlink.simulator import MavlinkSimulator, free_port
from soter.adapters.mavlink.transport import Address
from soter.adapters.mavlink.vehicle import ARDUROVER, EVERYBODY, kind_of
from soter.conformance import WIDE_ROOMS, ImpairedRelay, Line, RelayedHarness
from soter.conformance.harness import LIMITS, Harness, Killable, Switchable
from soter.errors import RobotUnavailable
from soter.sdk import Fleet, RobotSpec, Waypoint
from soter.sdk.wire import describe

_HOST: Final = "127.0.0.1"
_LOOK_S: Final = 0.02
_LARGEST: Final = 65536
_SYSTEM_AT: Final = 5
_MESSAGE_AT: Final = slice(7, 10)
_HEARTBEAT: Final = bytes(3)
_MANUAL: Final = 0.0
_ASIDE_M: Final = 0.8
_STATION: Final = 250
_FORCED: Final = 20190226.0
_BOOT_S: Final = "0.5"
"""Enough to see a vehicle get ready; the kit starts hundreds of them."""


class MavlinkRelay(ImpairedRelay):
    """Passes datagrams on, both ways; broadcasts to those vehicles that share no socket with one that is cut off.

    Args:
        adapter_port: the port on which the adapter listens.
        listens: the address to which the vehicles send; port 0 for any free port.

    Attributes:
        heartbeats: the latest one of each vehicle, as it came.
    """

    def __init__(self, adapter_port: int, listens: tuple[str, int] = (_HOST, 0)) -> None:
        self._vehicles: Final = _bound(listens)
        self._adapter: Final = _bound()
        self.port: Final[int] = self._vehicles.getsockname()[1]
        self._parser: Final = mav.MAVLink(None)
        self._parser.robust_parsing = True
        self._peers: dict[tuple[str, int], set[int]] = {}
        self.heartbeats: Final[dict[int, bytes]] = {}
        # Vehicles share a link, and so its order. The vehicle of each datagram is looked up, to cut off only some.
        self._up: Final = Line(EVERYBODY, lambda datagram: _send(self._adapter, datagram, (_HOST, adapter_port)))
        self._down: Final = Line(EVERYBODY, self._tell)
        self._broadcast: Final = Line(EVERYBODY, lambda datagram: self._tell(datagram, self.cut))
        super().__init__()
        self._ended: Final = threading.Event()
        self._hearing: Final = threading.Thread(target=self._hear, name="mavlink-relay", daemon=True)
        self._hearing.start()

    def close(self) -> None:
        self._ended.set()
        self._hearing.join()
        super().close()
        self._vehicles.close()
        self._adapter.close()

    def damaged(self, message: bytes) -> tuple[bytes, ...]:
        # The last byte is of the checksum, or of the signature behind it.
        return (message[:-1] + bytes([message[-1] ^ 0xFF]),)

    def tell(self, message: mav.MAVLink_message, system: int) -> None:
        """Send the vehicles a message as if it came from the keeper of a ground station."""
        self._tell(message.pack(mav.MAVLink(None, system, KEEPER)))

    def _tell(self, datagram: bytes, but: Collection[int] = ()) -> None:
        # Simulated vehicles share a socket, others have one each, and know by the ids what is for them.
        for peer, systems in tuple(self._peers.items()):
            if systems.isdisjoint(but):
                _send(self._vehicles, datagram, peer)

    def _hear(self) -> None:
        while not self._ended.is_set():
            for ready in select.select([self._vehicles, self._adapter], [], [], _LOOK_S)[0]:
                self._take(ready)

    def _take(self, ready: socket.socket) -> None:
        upwards = ready is self._vehicles
        while True:
            try:
                datagram, peer = ready.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:
                # The other end is not there: an earlier datagram to it came back as an error.
                continue
            if upwards:
                system, line = self._sender(datagram), self._up
                self._peers.setdefault(peer, set()).add(system)
                if datagram[_MESSAGE_AT] == _HEARTBEAT:
                    self.heartbeats[system] = datagram
            else:
                system = self._addressee(datagram)
                line = self._broadcast if system == EVERYBODY else self._down
            if line is self._broadcast or not (self.cut and (system in self.cut or system == EVERYBODY)):
                self.pass_on(line, datagram)

    @staticmethod
    def _sender(datagram: bytes) -> int:
        # Autopilots may send incomplete packets.
        return datagram[_SYSTEM_AT] if len(datagram) > _SYSTEM_AT else EVERYBODY

    def _addressee(self, datagram: bytes) -> int:
        for message in self._parser.parse_buffer(datagram) or ():
            return int(getattr(message, "target_system", EVERYBODY))
        return EVERYBODY


def _bound(at: tuple[str, int] = (_HOST, 0)) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(at)
    opened.setblocking(False)
    return opened


def _send(source: socket.socket, datagram: bytes, to: tuple[str, int]) -> None:
    # The receiver may be gone.
    with suppress(OSError):
        source.sendto(datagram, to)


class MavlinkHarness(RelayedHarness):
    """Opens simulated rovers behind a relay, new ones for every fleet."""

    name = "mavlink"
    connect_timeout_s = 30.0
    backend: ClassVar[type[VehicleBackend]] = MavlinkBackend
    options: ClassVar[dict[str, Any]] = {}
    simulator_options: ClassVar[tuple[str, ...]] = ()

    def open(self, robots: int) -> Fleet:
        port = free_port()
        self.relay = relay = MavlinkRelay(port)
        simulator = self._start(robots, relay.port)
        self.fleet = self._opened(port, simulator.truth, robots)
        return self.fleet

    @staticmethod
    def between(config: MavlinkConfig) -> tuple[MavlinkRelay, MavlinkConfig] | None:
        """Return a relay to given vehicles that send to a UDP port, and options that connect to the relay.

        Raises:
            RobotUnavailable: the port is taken.
        """
        address = None if config.connection is None else Address.parse(config.connection)
        if address is None or address.kind != "udpin":
            return None
        port = free_port()
        try:
            relay = MavlinkRelay(port, (address.host, address.port))
        except OSError as failure:
            raise RobotUnavailable(f"'{address}' cannot be listened at: {failure}") from failure
        return relay, config.model_copy(update={"connection": f"udpin:{_HOST}:{port}"})

    def switchable(self) -> Switchable:
        """Return a fleet of one fresh vehicle without a relay and without ground truth, to be switched off and on."""
        port = free_port()
        self._watched(port)
        self.fleet = self._opened(port, None, 1)
        return Switchable(self.fleet, self._end, lambda: self._watched(port))

    def killable(self) -> Killable:
        """Return a fleet of one vehicle that the backend simulates itself, and the call that kills its program."""
        fleet = self.faster(1.0)
        assert isinstance(fleet.simulator, MavlinkSimulator)
        return Killable(fleet, fleet.simulator.process.kill)

    def faster(self, speedup: float) -> MavlinkFleet:
        given = {"workspace": WIDE_ROOMS, "limits": LIMITS, "speedup": speedup, **self.options}
        self.fleet = fleet = self.backend().open(MavlinkConfig.model_validate(given), self.specs(1))
        return fleet

    def refusing(self) -> tuple[Fleet, str]:
        """Return a vehicle that does not arm, since its battery is empty."""
        return self.charged(0.0), "Battery 1 is empty"

    def specs(self, robots: int) -> list[RobotSpec]:
        found = super().specs(robots)
        # An empty battery stays so where there is no charger.
        return [replace(each, x_m=each.x_m + _ASIDE_M) for each in found] if self._charge == 0.0 else found

    def stall(self, robot_id: int, seconds: float) -> None:
        """Suspend the vehicles' program for a time; afterwards the simulation catches up."""
        assert isinstance(self.simulator, MavlinkSimulator)
        self.stopped(self.simulator.process, seconds)

    def restart(self, robot_id: int) -> None:
        """Reboot a vehicle, armed as it is, in the adapter's name: it obeys nobody else while the lease lives."""
        self._command(self._own(), robot_id, mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0, 0.0, 0.0, 0.0, _FORCED)

    def seize(self, robot_id: int) -> None:
        """Have another ground station set the mode in which the vehicle stands."""
        custom = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self._command(_STATION, robot_id, mav.MAV_CMD_DO_SET_MODE, custom, ARDUROVER.stop)

    def by_hand(self, robot_id: int) -> None:
        """Set the mode MANUAL, as a remote control's switch does.

        The vehicle is told in the adapter's name, since a program may only stop it while the lease lives.
        """
        custom = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self._command(self._own(), robot_id, mav.MAV_CMD_DO_SET_MODE, custom, _MANUAL)

    def shown(self, robot_id: int) -> str:
        """Return the mode of a vehicle, and whether it is armed, as its latest heartbeat says."""
        assert isinstance(self.relay, MavlinkRelay)
        beat = mav.MAVLink(None).parse_char(self.relay.heartbeats[robot_id])
        armed = beat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED
        mode = kind_of(beat.type, beat.autopilot).names.get(beat.custom_mode, beat.custom_mode)
        return f"mode {mode}, {'armed' if armed else 'disarmed'}"

    def disable(self, robot_id: int) -> None:
        """Have another ground station disarm the vehicle."""
        self._command(_STATION, robot_id, mav.MAV_CMD_COMPONENT_ARM_DISARM)

    def _own(self) -> int:
        """Return the adapter's system id."""
        return int(self.options.get("system_id", MavlinkConfig.model_fields["system_id"].default))

    def _command(self, source: int, robot_id: int, command: int, *numbers: float) -> None:
        """Command a vehicle in the name of a system; numbers that are not given are 0."""
        told = mav.MAVLink_command_long_message(
            robot_id, mav.MAV_COMP_ID_AUTOPILOT1, command, 0, *numbers, *[0.0] * (7 - len(numbers))
        )
        assert isinstance(self.relay, MavlinkRelay)
        self.relay.tell(told, source)

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        port = free_port()
        simulator = self._watched(port)
        harness = f"{type(self).__module__}:{type(self).__qualname__}"
        argument = json.dumps({"harness": harness, "port": port, "truth": simulator.truth})
        return self.driven(f"{__name__}:open_given", argument, target)

    def _watched(self, port: int) -> MavlinkSimulator:
        simulator = self._start(1, port)
        self._watch(simulator)
        return simulator

    def _start(self, robots: int, port: int) -> MavlinkSimulator:
        rate_hz = self.options.get("stream_hz", STREAM_HZ)
        vehicle = self.options.get("vehicle", "rover")
        options = ("--vehicle", vehicle, "--rate", str(rate_hz), "--boot", _BOOT_S, *self.simulator_options)
        self.simulator = simulator = MavlinkSimulator(describe(WIDE_ROOMS, self.specs(robots), LIMITS), port, *options)
        return simulator

    def _opened(self, port: int, truth: str | None, robots: int) -> MavlinkFleet:
        config = MavlinkConfig.model_validate(
            {"workspace": WIDE_ROOMS, "connection": f"udpin:127.0.0.1:{port}", "truth": truth, **self.options}
        )
        return self.backend().open(config, self.asked(robots))


class CopterHarness(MavlinkHarness):
    """Opens simulated copters."""

    name = "mavlink (copter)"
    options: ClassVar[dict[str, Any]] = {"vehicle": "copter"}
    # A copter is charged on the ground only, and the kit's fly.
    charges_at_start = False
    # After a reboot a copter has to get ready, arm and take off again, which takes longer than the kit waits.
    switchable = Harness.switchable
    restart = Harness.restart
    # The mode in which it stands has another number than a rover's; without its motors it would fall.
    seize = Harness.seize
    by_hand = Harness.by_hand
    disable = Harness.disable


class PlainHarness(MavlinkHarness):
    """Opens simulated rovers that, like real autopilots, have no gate and no lease."""

    name = "mavlink (plain rover)"
    simulator_options: ClassVar[tuple[str, ...]] = ("--plain",)
    # After a reboot such a rover has to get ready and arm again, which takes longer than the kit waits.
    switchable = Harness.switchable
    restart = Harness.restart


class MavsdkHarness(MavlinkHarness):
    """Opens simulated rovers for the backend `mavsdk`."""

    name = "mavsdk"
    backend: ClassVar[type[VehicleBackend]] = MavsdkBackend


class MavsdkCopterHarness(CopterHarness):
    """Opens simulated copters for the backend `mavsdk`."""

    name = "mavsdk (copter)"
    backend: ClassVar[type[VehicleBackend]] = MavsdkBackend


def open_given(argument: str) -> Fleet:
    """Open the first robot at a port that is given as JSON; called in the kit's driver process."""
    given = json.loads(argument)
    harness = HARNESSES[given["harness"].rpartition(":")[2]]()
    return harness._opened(given["port"], given["truth"], 1)


HARNESSES: Final = {
    each.__name__: each for each in (MavlinkHarness, CopterHarness, PlainHarness, MavsdkHarness, MavsdkCopterHarness)
}
