"""A speed limit in a zone: whoever is inside the zone is no faster than the limit."""

from dataclasses import dataclass
from math import cos, hypot, pi, sin

from pydantic import BaseModel

from soter.rta import Node, Region, RTAModule, Situation
from soter.sdk import Waypoint
from soter.stack.user_modules import ModuleKit
from soter.workspace import Box


class Options(BaseModel, extra="forbid", frozen=True):
    """The zone as west, south, east and north in metres, and the limit that holds in it."""

    zone: tuple[float, float, float, float]
    limit_m_s: float


@dataclass(frozen=True)
class SlowInside(Region):
    """Metres to the zone. Inside it is enough to be slow: for the rule, but not for trusting the AC."""

    zone: Box
    limit_m_s: float
    least_m: float = 0.0

    def margin(self, situation: Situation) -> float:
        own = situation.own
        slower_m_s = self.limit_m_s - hypot(own.vx_m_s, own.vy_m_s)
        return max(self.zone.distance_m(own.x_m, own.y_m), 0.01 * slower_m_s) - self.least_m

    def edge_margin(self, safer: Region) -> float:
        return safer.least_m - self.least_m if isinstance(safer, SlowInside) else float("nan")


class CrossSlowly(Node):
    """Goes on through the zone, or leaves it to a side or backwards; slowly in any case."""

    name, publishes = "cross-slowly", ("waypoint",)

    def __init__(self, kit: ModuleKit, zone: Box, speed_m_s: float) -> None:
        self.kit, self.zone, self.speed_m_s, self.period_s = kit, zone, speed_m_s, kit.tick_s

    def engage(self, situation: Situation) -> None:
        own, turns, lengths = situation.own, [pi / 8 * k for k in range(9)], [0.1 * k for k in range(1, 60)]
        rays = [(own.heading_rad + side * turn, length) for turn in turns for side in (1, -1) for length in lengths]
        places = [(own.x_m + length * cos(angle), own.y_m + length * sin(angle)) for angle, length in rays]
        self.place = next((place for place in places if self.good(situation, *place)), (own.x_m, own.y_m))

    def good(self, situation: Situation, x_m: float, y_m: float) -> bool:
        """Whether a place is outside, can be stood on, and lies in sight."""
        free = self.kit.terrain.fence_m(x_m, y_m) > 0.3 and self.kit.terrain.clearance_m(x_m, y_m) > 0.12
        return free and self.zone.distance_m(x_m, y_m) > 0.25 and self.kit.recovery.sees(situation, x_m, y_m, 0.12)

    def step(self, situation: Situation) -> None:
        self.kit.waypoint.publish(Waypoint(*self.place, speed_m_s=self.speed_m_s))


def declare(kit: ModuleKit, options: Options) -> RTAModule:
    """Declare the module for one robot."""
    zone, limit_m_s = Box(*options.zone), options.limit_m_s
    sc = CrossSlowly(kit, zone, 0.9 * limit_m_s)
    safe, safer = SlowInside(zone, limit_m_s), SlowInside(zone, limit_m_s, 0.2)
    return RTAModule(kit.name, kit.ac, sc, 0.1, safe, safer, kit.model)
