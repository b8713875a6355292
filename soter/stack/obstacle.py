"""Obstacle: the robot's body stays clear of the known boxes."""

from __future__ import annotations

from dataclasses import dataclass

from soter.rta import Region, Situation, Threat
from soter.stack.terrain import Terrain


@dataclass(frozen=True)
class Clearance(Region):
    """Positions in which the body is at least `least_m` clear of every box.

    Attributes:
        terrain: the boxes.
        least_m: clearance at the edge of the region.
    """

    terrain: Terrain
    least_m: float = 0.0

    def margin(self, situation: Situation) -> float:
        own = situation.own
        return self.terrain.clearance_m(own.x_m, own.y_m) - self.least_m

    def threats(self, situation: Situation) -> list[Threat]:
        own = situation.own
        walls = self.terrain.walls(own.x_m, own.y_m)
        return [Threat(clearance - self.least_m, ux, uy) for clearance, ux, uy in walls]

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Clearance):
            raise TypeError(f"phi_safer of a clearance is a clearance, not {type(safer).__name__}")
        return safer.least_m - self.least_m
