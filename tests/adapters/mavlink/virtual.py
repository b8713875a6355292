"""The real adapter and the real simulated vehicles, on a wire without sockets and in virtual time.

`tests.adapters.mavlink.virtual:VirtualBackend` is the backend `mavlink` but for its clock and its wire. The wire that
it opened last is `VirtualBackend.wire`, with which a test lets happen what happens to vehicles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Final, Literal

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.backend import MavlinkBackend
from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.pymavlink_link import PymavlinkLink
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.adapters.mavlink.transport import Address
from soter.clock import VehicleClock
from soter.sdk import BackendConfig, Capabilities, Fleet, Robot, RobotSpec
from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.channel import Channel
from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.simulation import Settings, Simulation

BACKEND: Final = f"{__name__}:VirtualBackend"
_SYSTEM_AT: Final = 5
_ROUNDING_S: Final = 1e-9


class Wire(Simulation):
    """Vehicles whose world goes on while the adapter sleeps, and which hear at once what it sends.

    Attributes:
        host_s: what the host's clock shows.
        heard: takes what the vehicles say.
        cut: systems that neither hear nor are heard.
        between: called before each control period.
    """

    address = "virtual"

    def __init__(self, robots: Sequence[RobotSpec], config: MavlinkConfig, like: str | None) -> None:
        self.host_s = 0.0
        self.cut: Final[set[int]] = set()
        self.heard: Any = None
        self.between: Callable[[], object] = lambda: None
        place = config.origin
        origin = Origin() if place is None else Origin(place.lat_deg, place.lon_deg, place.alt_m)
        rate_hz = config.stream_hz
        settings = Settings(
            vehicle="copter" if config.vehicle == "copter" else "rover", tcp=(0,), rate_hz=rate_hz, like=like,
            boot_s=config.boot_s, origin=origin, limits=config.limits,
        )  # fmt: skip
        super().__init__(config.workspace, robots, settings)
        self._others: Final = Channel(lambda _: None, None, datagrams=True)
        self._other: Final = mav.MAVLink(None, 254, mav.MAV_COMP_ID_MISSIONPLANNER)
        self.channels: Final = (Channel(self._say, None, datagrams=True),)
        self.links.append(self)

    def clock_s(self) -> float:
        return self.host_s

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        until_s = self.host_s + seconds
        while self.world.now_s + self.world.period_s <= until_s + _ROUNDING_S:
            self.host_s = max(self.world.now_s + self.world.period_s, self.host_s)
            self.between()
            self.step()
        self.host_s = until_s

    def other(self, message: mav.MAVLink_message) -> None:
        """Let another ground station send a message."""
        self._take(self._others, message.pack(self._other))

    def command(self, robot_id: int, number: int, *params: float) -> None:
        """Let another ground station send a command."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.other(mav.MAVLink_command_long_message(robot_id, 1, number, 0, *values))

    def autopilot(self, robot_id: int) -> Autopilot:
        """Return a robot's."""
        return next(each for each in self.autopilots if each.id == robot_id)

    # --- a transport, as the adapter's link sees it ----------------------------------------------------------

    def send(self, packet: bytes, _peer: object) -> None:
        self._take(self.channels[0], packet)

    def _take(self, channel: Channel, packet: bytes) -> None:
        for source, message in channel.parse(packet):
            for station in self._stations:
                if station.autopilot.id not in self.cut:
                    station.hear(channel, source, message)

    def _say(self, packet: bytes) -> None:
        if packet[_SYSTEM_AT] not in self.cut:
            self.heard(packet, None)


class _Link(PymavlinkLink):
    def __init__(self, wire: Wire, clock: VehicleClock) -> None:
        super().__init__(clock, Address("udpin", "127.0.0.1", 1), 255, COMPONENTS)
        self._wire: Final = wire

    def start(self) -> None:
        self._wire.heard = self._take
        self._transport = self._wire  # type: ignore[assignment]

    def close(self) -> None:
        self._transport = None


class _Robot(MavlinkRobot):
    declared: ClassVar[Capabilities] = replace(MavlinkRobot.declared, in_process=True, deterministic=True)


class _Fleet(Fleet):
    def __init__(self, wire: Wire, clock: VehicleClock, robots: Sequence[Robot]) -> None:
        super().__init__(clock, robots, wire.world.truth)
        self._wire: Final = wire

    def _close(self) -> None:
        self._wire.close()


class VirtualConfig(MavlinkConfig):
    """Options of it: those of `mavlink`, and the flaws."""

    like: Literal["ardurover", "ardurover-boat", "arducopter", "px4"] | None = None


class VirtualBackend(MavlinkBackend):
    """The backend `mavlink` in virtual time."""

    config_model: ClassVar[type[BackendConfig]] = VirtualConfig
    robot_class: ClassVar[type[Robot]] = _Robot
    wire: ClassVar[Wire]

    @classmethod
    def promises(cls, config: MavlinkConfig) -> Capabilities:
        return replace(config.promised(), in_process=True, deterministic=True)

    def open(self, config: VirtualConfig, robots: Sequence[RobotSpec]) -> Fleet:  # type: ignore[override]
        robots = [replace(spec, promised=spec.promised or self.promises(config)) for spec in robots]
        type(self).wire = wire = Wire(robots, config, config.like)
        clock = VehicleClock(steady=lambda: wire.host_s, sleep=wire.sleep)
        link = _Link(wire, clock)
        for spec in robots:
            link.inboxes[spec.id] = Inbox()
        link.start()
        made: list[_Robot] = []
        made += [_Robot(spec, clock, link, config, made) for spec in robots]
        return _Fleet(wire, clock, made)
