"""What an adversary is given, and what it has to do; and the nearest edges of what must not happen."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Annotated, Any, ClassVar, Final, Generic, NamedTuple, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from soter.config_tables import RtaTable
from soter.rta import Report
from soter.sdk import RobotState, Waypoint
from soter.stack.kit import RobotPort
from soter.stack.terrain import Terrain

BEYOND_M: Final = 1.0
"""How far beyond an edge an attack aims, so that the robot does not slow down before it."""

Positive = Annotated[float, Field(ge=0.001, le=1e6, allow_inf_nan=False)]


class RobotFacts(BaseModel):
    """What an adversary takes for granted about the robots; wrong numbers make it a weaker one.

    Attributes:
        v_max_m_s: their top speed.
        brake_m_s2: how fast they brake.
        latency_s: their declared latency.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    v_max_m_s: Positive = 0.22
    brake_m_s2: Positive = 1.0
    latency_s: Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)] = 0.05

    def reach_m(self, delta_s: float, robots: int = 1) -> float:
        """Return the margin at which a module with this Delta takes a robot, when `robots` of them close in."""
        stop_m = self.v_max_m_s**2 / (2.0 * self.brake_m_s2)
        return robots * (self.v_max_m_s * (2.0 * delta_s + self.latency_s) + stop_m)


class AdversaryOptions(BaseModel):
    """What every adversary can be told in `[adversaries.NAME]`; an adversary's own model adds its options.

    Attributes:
        facts: what it takes for granted about the robots.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    facts: RobotFacts = RobotFacts()


@dataclass(frozen=True)
class Arena:
    """Where an adversary plays, and with what.

    Attributes:
        terrain: fence and boxes.
        ports: the ACs' rights, by robot; all that may be touched.
        rta: what the safety modules promise; an adversary knows it.
        base_tick_s: period of the supervisors.
        seed: of the run.
    """

    terrain: Terrain
    ports: Mapping[int, RobotPort]
    rta: RtaTable
    base_tick_s: float
    seed: int

    def random(self, name: str) -> Random:
        """Return random numbers that depend on the run's seed and the name alone."""
        return Random(f"adversary {name}, seed {self.seed}")

    def states(self) -> dict[int, RobotState]:
        """Return the latest sample of every robot that has one."""
        return {robot_id: port.state for robot_id, port in self.ports.items() if port.state is not None}

    def peers_of(self, robot_id: int) -> list[RobotState]:
        """Return the others, the nearest first."""
        states = self.states()
        own = states.pop(robot_id, None)
        if own is None:
            return []
        return sorted(states.values(), key=lambda peer: (peer.x_m - own.x_m) ** 2 + (peer.y_m - own.y_m) ** 2)

    def looked(self, tick: int, delta_s: float) -> bool:
        """Return whether the module with this Delta looked at this tick: it will not look again for a whole Delta."""
        return tick % max(1, round(delta_s / self.base_tick_s)) == 0


O = TypeVar("O", bound=AdversaryOptions)  # noqa: E741 - the letter of its bound


class Adversary(ABC, Generic[O]):
    """An AC for all robots at once that does its worst. Called after every tick, in the supervisor's thread.

    Whatever it does must follow from its options, the arena, and what ports show: the same seed, the same attack.
    Where it cannot keep to that it says so by `incidents`.

    Args:
        options: an instance of `options_model`.
    """

    options_model: ClassVar[type[AdversaryOptions]] = AdversaryOptions
    """Validates the table `[adversaries.NAME]`."""

    def __init__(self, options: O) -> None:
        self.options: Final = options

    def begin(self, arena: Arena) -> None:
        """Take the robots over; called once, before the first tick."""
        self.arena = arena

    @abstractmethod
    def act(self, now_s: float, tick: int) -> None:
        """Ask for what shall happen next. `tick` is the number of the tick that has just passed, from 0."""

    def hear(self, report: Report) -> None:
        """Take what a port reports, in the middle of a tick. Nothing by default."""

    @property
    def incidents(self) -> Sequence[str]:
        """What makes this run one that does not repeat."""
        return ()

    def close(self) -> None:
        """End what was started. Nothing by default."""


AnyAdversary = Adversary[Any]


def towards(own: RobotState, x_m: float, y_m: float, speed_m_s: float | None = None) -> Waypoint:
    """Return a goal `BEYOND_M` behind a place, on a straight line from where the robot is."""
    dx, dy = x_m - own.x_m, y_m - own.y_m
    length = (dx * dx + dy * dy) ** 0.5
    if length > 0.0:
        x_m, y_m = x_m + BEYOND_M * dx / length, y_m + BEYOND_M * dy / length
    return Waypoint(x_m, y_m, 0.0, None, speed_m_s, 0.005, 600.0)


RULES: Final = ("geofence", "obstacle", "collision")


class Edge(NamedTuple):
    """A place where a rule would be broken, and how far a robot is from that.

    Attributes:
        margin_m: the rule's margin where the robot is.
        x_m: where to drive to break it, east.
        y_m: the same, north.
    """

    margin_m: float
    x_m: float
    y_m: float


def nearest_edge(arena: Arena, own: RobotState, rule: str) -> Edge | None:
    """Return the nearest place where a robot would break a rule; None where there is none, as without boxes."""
    if rule == "geofence":
        return _fence(arena, own)
    return _box(arena, own) if rule == "obstacle" else _robot(arena, own)


def _fence(arena: Arena, own: RobotState) -> Edge:
    width_m, depth_m = arena.terrain.width_m, arena.terrain.depth_m
    return min(
        Edge(own.x_m, 0.0, own.y_m),
        Edge(width_m - own.x_m, width_m, own.y_m),
        Edge(own.y_m, own.x_m, 0.0),
        Edge(depth_m - own.y_m, own.x_m, depth_m),
    )


def _box(arena: Arena, own: RobotState) -> Edge | None:
    edges = []
    for box in arena.terrain.boxes:
        x_m = min(max(own.x_m, box.low_x_m), box.high_x_m)
        y_m = min(max(own.y_m, box.low_y_m), box.high_y_m)
        edges.append(Edge(math.hypot(x_m - own.x_m, y_m - own.y_m) - arena.terrain.body_radius_m, x_m, y_m))
    return min(edges, default=None)


def _robot(arena: Arena, own: RobotState) -> Edge | None:
    peers = arena.peers_of(own.robot_id)
    if not peers:
        return None
    peer, least_m = peers[0], arena.rta.collision.phi_safe_m
    return Edge(math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) - least_m, peer.x_m, peer.y_m)
