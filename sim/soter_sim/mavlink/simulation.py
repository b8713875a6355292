"""A world with an autopilot on every robot, in step with the host's clock."""

from __future__ import annotations

import logging
import selectors
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Final, Literal, Self

from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.copter import CopterEngine
from soter_sim.engine import EngineFactory
from soter_sim.kinematic import KinematicEngine
from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.boat import Boat, Holding, current_m_s
from soter_sim.mavlink.channel import Channel, Source
from soter_sim.mavlink.copter import Copter
from soter_sim.mavlink.flaws import BOAT_LIKE, LIKE, Flaws
from soter_sim.mavlink.frames import Globe, Origin
from soter_sim.mavlink.kinds import BOAT, KINDS, PX4_COPTER, ROVER, Kind
from soter_sim.mavlink.links import Link, TcpLink, UdpLink
from soter_sim.mavlink.rover import Rover
from soter_sim.mavlink.setpoint import Vehicle
from soter_sim.mavlink.station import Station
from soter_sim.mavlink.telemetry import Message
from soter_sim.truth_server import TruthServer
from soter_sim.world import ENGINES, World

logger = logging.getLogger(__name__)

_SYSTEM_MOST: Final = 254
# Most of its own time that a world makes up for after a delay of the host; it loses the rest.
_BEHIND_S: Final = 0.25
_RATE_HZ: Final = 40.0


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a simulation.

    Attributes:
        vehicle: "rover" or "copter".
        engine: "kinematic" or "pybullet"; copters and boats have the kinematic one only.
        udp: ports of this host on which ground stations listen.
        tcp: ports to listen on; 0 for any free one.
        truth: port that serves the truth; 0 for any free one.
        rate_hz: control periods per second; None for 40, or for PyBullet's 20, its only rate.
        streams_hz: highest rate of a message; None for once a control period.
        plain: without this simulation's additions to ArduPilot: master, lease, yaw and speed of a place.
        like: the real autopilot that it is like, with its flaws as far as they are known, see
            `soter_sim.mavlink.flaws`; also implies `plain`. None for none.
        speedup: simulated seconds per second, at most.
        boot_s: simulated time from power-on until an autopilot is ready.
        key: key of 32 bytes for signing, or None.
        origin: geographic origin of a workspace in metres; of one with geographic positions, only its height counts.
        limits: what the mission promises, by which the truth is judged.

    Raises:
        ValueError: a setting is not allowed; the message names it.
    """

    vehicle: Literal["rover", "copter"] = "rover"
    engine: str = "kinematic"
    udp: tuple[int, ...] = ()
    tcp: tuple[int, ...] = ()
    truth: int = 0
    rate_hz: float | None = None
    streams_hz: float | None = None
    plain: bool = False
    like: str | None = None
    speedup: float = 1.0
    boot_s: float = 2.0
    key: bytes | None = None
    origin: Origin = field(default_factory=Origin)
    limits: RuleLimits = field(default_factory=RuleLimits)

    @property
    def kind(self) -> Kind:
        """The kind of vehicle."""
        return {"px4": PX4_COPTER, BOAT_LIKE: BOAT}.get(self.like or "", KINDS[self.vehicle])

    def __post_init__(self) -> None:
        if self.vehicle not in KINDS:
            raise ValueError(f"vehicle is '{self.vehicle}', allowed: {', '.join(KINDS)}")
        if self.like is not None and LIKE.get(self.like) != self.vehicle:
            allowed = ", ".join(name for name, vehicle in LIKE.items() if vehicle == self.vehicle)
            raise ValueError(f"like is '{self.like}', allowed for a {self.vehicle}: {allowed}")
        if self.engine not in ENGINES:
            raise ValueError(f"engine is '{self.engine}', allowed: {', '.join(ENGINES)}")
        if self.kind != ROVER and self.engine != "kinematic":
            raise ValueError(f"engine is '{self.engine}', allowed for a {self.kind.name}: kinematic")
        for name, least in (("udp", 1), ("tcp", 0), ("truth", 0)):
            ports = getattr(self, name)
            for port in (ports,) if isinstance(ports, int) else ports:
                if not least <= port <= 65535:
                    raise ValueError(f"{name} is {port}, allowed: a port from {least} to 65535")
        if not self.udp and not self.tcp:
            raise ValueError("udp and tcp are empty, allowed: at least one port, or nobody could reach the vehicles")
        if self.rate_hz is not None:
            if self.engine != "kinematic":
                raise ValueError(f"rate_hz is {self.rate_hz}, allowed with the engine '{self.engine}': its own only")
            if not 10.0 <= self.rate_hz <= 200.0:
                raise ValueError(f"rate_hz is {self.rate_hz}, allowed: 10 to 200")
        if self.streams_hz is not None and not 1.0 <= self.streams_hz <= 200.0:
            raise ValueError(f"streams_hz is {self.streams_hz}, allowed: 1 to 200")
        if not 0.0 < self.speedup < inf:
            raise ValueError(f"speedup is {self.speedup}, allowed: above 0")
        if not 0.0 <= self.boot_s < inf:
            raise ValueError(f"boot_s is {self.boot_s}, allowed: 0 or more")
        if self.key is not None and len(self.key) != 32:
            raise ValueError(f"key has {len(self.key)} bytes, allowed: 32")


class Simulation:
    """The robots of a world, each with an autopilot, on links.

    Not thread-safe: one thread runs it. Only `stop` may be called from another thread, or from a signal handler.

    Args:
        workspace: fence, boxes and chargers.
        robots: the robots; their ids are their system ids.
        settings: the settings.

    Attributes:
        world: the world.
        autopilots: one for each robot.
        links: the links to them.
        truth: serves the ground truth.

    Raises:
        ValueError: a robot's start is not allowed, its id is no system id, or two origins are given.
        ImportError: the engine's library is not installed.
        OSError: a port is taken.
    """

    def __init__(self, workspace: Workspace, robots: Sequence[RobotSpec], settings: Settings) -> None:
        for spec in robots:
            if not 1 <= spec.id <= _SYSTEM_MOST:
                raise ValueError(f"robot has the id {spec.id}, allowed on MAVLink: 1 to {_SYSTEM_MOST}")
        kind = settings.kind
        plan = workspace.plan.origin if isinstance(workspace, Site) else None
        there = settings.origin
        if plan is not None and there[:2] != Origin()[:2]:
            raise ValueError("origin is given, and the workspace says itself where on earth it is; leave it out")
        self._origin: Final = there if plan is None else Globe(plan.lat_deg, plan.lon_deg, there.alt_m)
        self._settings: Final = settings
        self._stopped = False
        self._stepped_at_s = time.perf_counter()
        self.links: Final[list[Link]] = []
        with ExitStack() as stack:
            selector = self._selector = stack.enter_context(selectors.DefaultSelector())
            self.world: Final = stack.enter_context(World(workspace, robots, _engine(settings), settings.limits))
            self._stations: Final = [self._add_autopilot(spec.id, kind) for spec in robots]
            self.autopilots: Final = [station.autopilot for station in self._stations]
            for port in settings.udp:
                self._add(stack, UdpLink(selector, self._hear, port, settings.key))
            for port in settings.tcp:
                self._add(stack, TcpLink(selector, self._hear, port, settings.key))
            self.truth: Final = TruthServer(self.world, settings.truth)
            stack.callback(self.truth.close)
            self._stack: Final = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def clock_s(self) -> float:
        """Return the world's time, interpolated between two control periods by the host's clock."""
        passed_s = (time.perf_counter() - self._stepped_at_s) * self._settings.speedup
        return self.world.now_s + min(max(passed_s, 0.0), self.world.period_s)

    def run(self, alive: Callable[[], bool] = lambda: True) -> None:
        """Keep pace with the host's clock until `stop` is called, or `alive`, called in every step, returns False.

        Delays of a busy host are made up for, up to a quarter of a simulated second; a host that lags for longer
        slows the world down.
        """
        speedup = self._settings.speedup
        period_s, behind_s = self.world.period_s / speedup, _BEHIND_S / speedup
        due_s = time.perf_counter() + period_s
        while not self._stopped and alive():
            self._listen(due_s)
            self.step()
            due_s = max(due_s + period_s, time.perf_counter() - behind_s)

    def step(self) -> None:
        """Take received messages, run one control period, and send what is due."""
        self._listen(-inf)
        world = self.world
        world.advance(world.now_s + world.period_s)
        self._stepped_at_s = time.perf_counter()
        for station in self._stations:
            station.tick(world.now_s)
        self.truth.tell()

    def stop(self) -> None:
        """End `run` after its present step."""
        self._stopped = True

    def close(self) -> None:
        """Close every socket, and free the world."""
        self._stack.close()

    def _add_autopilot(self, robot_id: int, kind: Kind) -> Station:
        """Put an autopilot on a robot."""
        settings, transmit = self._settings, partial(self._transmit, robot_id)
        world = self.world
        vehicle: Vehicle
        if isinstance(world.engine, CopterEngine):
            vehicle = Copter(world.engine, world.index(robot_id))
        else:
            vehicle = (Boat if kind == BOAT else Rover)(world, robot_id)
        autopilot = Autopilot(
            robot_id, kind, vehicle, self._origin, settings.boot_s, transmit,
            plain=settings.plain or settings.like is not None,
            flaws=self._flaws(kind),
        )  # fmt: skip
        if isinstance(vehicle, Boat):
            vehicle.current_m_s = lambda: current_m_s(autopilot.parameters) if autopilot.armed else (0.0, 0.0)
        most_hz = min(settings.streams_hz or inf, 1.0 / world.period_s)
        return Station(autopilot, self._channels, transmit, most_hz, self.clock_s)

    def _flaws(self, kind: Kind) -> Flaws | None:
        if self._settings.like is None or kind.is_px4:
            return None
        return Holding() if kind == BOAT else Flaws(flies=kind.flies)

    def _add(self, stack: ExitStack, link: Link) -> None:
        self.links.append(link)
        stack.callback(link.close)

    def _listen(self, until_s: float) -> None:
        """Take messages until the host's time `until_s`."""
        while True:
            left_s = until_s - time.perf_counter()
            for key, events in self._selector.select(max(left_s, 0.0)):
                key.data(events)
            if left_s <= 0.0:
                return

    def _hear(self, channel: Channel, by: Source, message: Message) -> None:
        for station in self._stations:
            station.hear(channel, by, message)

    def _channels(self) -> Iterable[Channel]:
        return [channel for link in self.links for channel in link.channels]

    def _transmit(self, robot_id: int, message: Message) -> None:
        for channel in self._channels():
            channel.send(robot_id, message)


def _engine(settings: Settings) -> str | EngineFactory:
    if settings.engine != "kinematic":
        return settings.engine
    step_s = 1.0 / (settings.rate_hz or _RATE_HZ)
    flies = KINDS[settings.vehicle].flies
    return partial(CopterEngine, step_s=step_s) if flies else partial(KinematicEngine, step_s=step_s)
