"""A speed limit in a zone: whoever is inside the zone is no faster than the limit."""

from dataclasses import dataclass
from math import hypot

from pydantic import BaseModel

from soter import ModuleKit
from soter.geometry.workspace import Box
from soter.rta import Region, RTAModule, Situation


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


def declare(kit: ModuleKit, options: Options) -> RTAModule:
    """Declare the module for one robot: it crosses the zone slowly, and gives the robot back on the other side."""
    zone, limit_m_s = Box(*options.zone), options.limit_m_s

    def beyond(situation: Situation) -> tuple[float, float]:
        return kit.place_ahead(situation, lambda x_m, y_m: zone.distance_m(x_m, y_m) > 0.25)

    sc = kit.go_to(beyond, 0.9 * limit_m_s)
    safe, safer = SlowInside(zone, limit_m_s), SlowInside(zone, limit_m_s, 0.2)
    return RTAModule(kit.name, kit.ac, sc, 0.1, safe, safer, kit.model, peers_within_m=0.0)
