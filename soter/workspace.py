"""The known workspace: fence, boxes, where robots start and charge. Metres, ENU, z up."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-aligned box on the ground, seen from above.

    Attributes:
        low_x_m: west edge.
        low_y_m: south edge.
        high_x_m: east edge.
        high_y_m: north edge.
        height_m: height above the ground.
    """

    low_x_m: float
    low_y_m: float
    high_x_m: float
    high_y_m: float
    height_m: float = 1.0

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the signed distance from a point to the box: negative inside, by the depth."""
        dx = max(self.low_x_m - x_m, x_m - self.high_x_m)
        dy = max(self.low_y_m - y_m, y_m - self.high_y_m)
        if dx > 0.0:
            return math.hypot(dx, dy) if dy > 0.0 else dx
        return max(dx, dy)

    @property
    def centre(self) -> tuple[float, float]:
        """The middle, x and y in metres."""
        return (self.low_x_m + self.high_x_m) / 2, (self.low_y_m + self.high_y_m) / 2


@dataclass(frozen=True, slots=True)
class RobotPlace:
    """Where one robot of the workspace starts and charges.

    Attributes:
        id: the robot's number, from 1.
        x_m: start, east.
        y_m: start, north.
        charger: its charging station, a flat patch; a robot charges while its centre is on one.
        heading_rad: start heading, counter-clockwise from east.
    """

    id: int
    x_m: float
    y_m: float
    charger: Box
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Workspace:
    """A rectangle from the origin to (width_m, depth_m), its boxes and its robots' places."""

    width_m: float
    depth_m: float
    boxes: tuple[Box, ...]
    robots: tuple[RobotPlace, ...]

    def clearance_m(self, x_m: float, y_m: float, body_radius_m: float) -> float:
        """Return the distance from a round body at a point to the nearest box; negative where they overlap."""
        return min((box.distance_m(x_m, y_m) for box in self.boxes), default=math.inf) - body_radius_m
