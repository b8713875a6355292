"""Geofence: the robot's centre stays inside a rectangle."""

from __future__ import annotations

from dataclasses import dataclass

from soter.rta import Region, Situation, Threat


@dataclass(frozen=True)
class Fence(Region):
    """A rectangle of positions; its margin is the distance to the nearest side, negative outside.

    Attributes:
        low_x_m: west side.
        high_x_m: east side.
        low_y_m: south side.
        high_y_m: north side.
    """

    low_x_m: float
    high_x_m: float
    low_y_m: float
    high_y_m: float

    def margin(self, situation: Situation) -> float:
        own = situation.own
        x, y = own.x_m, own.y_m
        return min(x - self.low_x_m, self.high_x_m - x, y - self.low_y_m, self.high_y_m - y)

    def threats(self, situation: Situation) -> tuple[Threat, ...]:
        own = situation.own
        x, y = own.x_m, own.y_m
        return (
            Threat(x - self.low_x_m, -1.0, 0.0),
            Threat(self.high_x_m - x, 1.0, 0.0),
            Threat(y - self.low_y_m, 0.0, -1.0),
            Threat(self.high_y_m - y, 0.0, 1.0),
        )

    def edge_margin(self, safer: Region) -> float:
        if not isinstance(safer, Fence):
            raise TypeError(f"phi_safer of a fence is a fence, not {type(safer).__name__}")
        return min(
            safer.low_x_m - self.low_x_m,
            self.high_x_m - safer.high_x_m,
            safer.low_y_m - self.low_y_m,
            self.high_y_m - safer.high_y_m,
        )

    def inset(self, by_m: float) -> Fence:
        """Return the fence drawn in by `by_m` on every side."""
        return Fence(self.low_x_m + by_m, self.high_x_m - by_m, self.low_y_m + by_m, self.high_y_m - by_m)
