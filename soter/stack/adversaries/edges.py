"""The nearest edges of what must not happen: of the fence, of boxes, of other robots."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from soter.sdk import RobotState
from soter.stack.adversaries.base import Arena

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
