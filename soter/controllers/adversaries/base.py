"""The base of adversaries, and the nearest places where robots would break a rule."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, NamedTuple

from pydantic import BaseModel, Field

from soter.controllers.base import Arena, Controller, ControllerOptions
from soter.sdk import RobotState, Waypoint
from soter.stack.site_terrain import SiteTerrain
from soter.stack.terrain import Point

BEYOND_M: Final = 1.0
"""How far beyond an edge an attack aims, so that the robot does not slow down before it."""

Ring = list[Point]

_SHARP: Final = 0.3

Positive = Annotated[float, Field(ge=0.001, le=1e6, allow_inf_nan=False)]


class RobotFacts(ControllerOptions):
    """What an adversary assumes about the robots; wrong numbers make it weaker."""

    v_max_m_s: Positive = 0.22
    brake_m_s2: Positive = 1.0
    latency_s: Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)] = 0.05

    def reach_m(self, delta_s: float, robots: int = 1) -> float:
        """Return the margin at which a module with this Delta takes a robot, when `robots` of them close in."""
        stop_m = self.v_max_m_s**2 / (2.0 * self.brake_m_s2)
        return robots * (self.v_max_m_s * (2.0 * delta_s + self.latency_s) + stop_m)


class AdversaryOptions(ControllerOptions):
    """Options of every adversary; an adversary's own model adds more.

    Attributes:
        facts: what it assumes about the robots.
    """

    facts: RobotFacts = RobotFacts()


class Adversary(Controller, ABC):
    """A hostile controller of all robots at once. It knows the safety modules' settings."""

    Options: ClassVar[type[BaseModel]] = AdversaryOptions
    options: AdversaryOptions
    fleet = per_process = True

    @abstractmethod
    def act(self, now_s: float, tick: int) -> None: ...


def rings_where_control_is_lost(arena: Arena, facts: RobotFacts, spare_m: float) -> tuple[list[Ring], list[Ring]]:
    """Return the outlines at which an AC loses control, along the fence and around obstacles; lists may be empty.

    Args:
        arena: the arena.
        facts: the adversary's assumptions about the robots.
        spare_m: how far on the allowed side of these the outlines lie; negative for beyond.
    """
    fence, kept_out = arena.terrain.workspace.outlines()
    inset_m = facts.reach_m(arena.rta.geofence.delta_s) + spare_m
    off_m = facts.reach_m(arena.rta.obstacle.delta_s) + spare_m
    off_m += arena.terrain.body_radius_m + arena.rta.obstacle.phi_safe_m
    return [moved(fence, -inset_m)] if fence else [], [moved(ring, off_m) for ring in kept_out]


def moved(ring: Sequence[Point], by_m: float) -> Ring:
    """Return the corners of a polygon with all sides moved outwards; sharp corners are cut short."""
    sides = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    around = math.copysign(1.0, sum(ax * by - bx * ay for (ax, ay), (bx, by) in sides))
    units = [
        (around * (by - ay) / math.dist((ax, ay), (bx, by)), around * (ax - bx) / math.dist((ax, ay), (bx, by)))
        for (ax, ay), (bx, by) in sides
    ]
    corners = []
    for index, (x_m, y_m) in enumerate(ring):
        (ax, ay), (bx, by) = units[index - 1], units[index]
        scale = by_m / max(1.0 + ax * bx + ay * by, _SHARP)
        corners.append((x_m + scale * (ax + bx), y_m + scale * (ay + by)))
    return corners


def towards(own: RobotState, x_m: float, y_m: float, speed_m_s: float | None = None) -> Waypoint:
    """Return a goal `BEYOND_M` behind a place, on a straight line from where the robot is."""
    dx, dy = x_m - own.x_m, y_m - own.y_m
    length = (dx * dx + dy * dy) ** 0.5
    if length > 0.0:
        x_m, y_m = x_m + BEYOND_M * dx / length, y_m + BEYOND_M * dy / length
    return Waypoint(x_m, y_m, 0.0, None, speed_m_s, 0.005, 600.0)


RULES: Final = ("geofence", "obstacle", "collision")


class Edge(NamedTuple):
    """A place where a robot would break a rule, and the margin that it has now.

    Attributes:
        margin_m: the rule's margin where the robot is.
        x_m: where to drive to break the rule, east.
        y_m: where to drive to break the rule, north.
    """

    margin_m: float
    x_m: float
    y_m: float


def nearest_edge(arena: Arena, own: RobotState, rule: str) -> Edge | None:
    """Return the nearest place where a robot would break a rule; None if there is none, as without boxes."""
    if rule == "geofence":
        return _fence(arena, own)
    return _box(arena, own) if rule == "obstacle" else _robot(arena, own)


def _fence(arena: Arena, own: RobotState) -> Edge | None:
    terrain = arena.terrain
    if isinstance(terrain, SiteTerrain):
        reach_m = terrain.fence_m(own.x_m, own.y_m) + 1e-6
        walls = terrain.site.outside.walls(own.x_m, own.y_m, reach_m) if reach_m < math.inf else []
        return _beyond(own, min(walls)) if walls else None
    width_m, depth_m = terrain.width_m, terrain.depth_m
    return min(
        Edge(own.x_m, 0.0, own.y_m),
        Edge(width_m - own.x_m, width_m, own.y_m),
        Edge(own.y_m, own.x_m, 0.0),
        Edge(depth_m - own.y_m, own.x_m, depth_m),
    )


def _beyond(own: RobotState, wall: tuple[float, float, float]) -> Edge:
    away_m, ux, uy = wall
    return Edge(away_m, own.x_m + away_m * ux, own.y_m + away_m * uy)


def _box(arena: Arena, own: RobotState) -> Edge | None:
    edges = []
    if isinstance(arena.terrain, SiteTerrain):
        walls = arena.terrain.walls(own.x_m, own.y_m, arena.terrain.clearance_m(own.x_m, own.y_m) + 1e-6)
        return min((_beyond(own, wall) for wall in walls), default=None)
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
