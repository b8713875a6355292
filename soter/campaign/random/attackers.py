"""User-made parts of drawn configurations: an AC that stands in others' way, and modules with rules of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field

from soter.controllers.adversaries import Adversary, AdversaryOptions
from soter.rta import Region, RTAModule, Situation
from soter.rta.models import PairBound
from soter.sdk import Waypoint
from soter.stack.module_kit import ModuleKit

_THERE_M: Final = 0.03
_AGAIN_TICKS: Final = 5

Place = Annotated[tuple[float, float], Field(strict=False)]


class VisitOptions(AdversaryOptions):
    """Options of `Visit`.

    Attributes:
        places: metres east and north, in the order in which they are visited, back and forth.
        stay_s: how long a robot stays at each.
        parked: by robot id, a place of the robot's own to drive to and stay at for good.
    """

    places: Annotated[tuple[Place, ...], Field(strict=False, min_length=1)]
    stay_s: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    parked: dict[str, Place] = Field(default_factory=dict)


class Visit(Adversary):
    """Every robot visits the same places, back and forth, each beginning at another one: stations, gaps, far ends."""

    Options = VisitOptions
    options: VisitOptions

    def act(self, now_s: float, tick: int) -> None:
        """Send robots on that have stayed for long enough."""
        places = self.options.places
        order = [*range(len(places)), *range(len(places) - 2, 0, -1)]
        if tick == 0:
            self._at = {robot_id: index for index, robot_id in enumerate(self.arena.ports)}
            self._since_s = dict.fromkeys(self.arena.ports, math.inf)
        if tick % _AGAIN_TICKS:
            return
        for robot_id, port in self.arena.ports.items():
            own = port.state
            if own is None or not port.engaged:
                continue
            if str(robot_id) in self.options.parked:
                port.goto(Waypoint(*self.options.parked[str(robot_id)], radius_m=_THERE_M))
                continue
            x_m, y_m = places[order[self._at[robot_id] % len(order)]]
            if math.dist((own.x_m, own.y_m), (x_m, y_m)) <= _THERE_M:
                self._since_s[robot_id] = min(self._since_s[robot_id], now_s)
            if now_s - self._since_s[robot_id] >= self.options.stay_s:
                self._at[robot_id] += 1
                self._since_s[robot_id] = math.inf
                x_m, y_m = places[order[self._at[robot_id] % len(order)]]
            port.goto(Waypoint(x_m, y_m, radius_m=_THERE_M))


class _Options(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FarOptions(_Options):
    """Options of `declare_far`.

    Attributes:
        far_m: phi_safe: the least distance between centres.
        spare_m: how much more phi_safer requires.
    """

    far_m: float
    spare_m: float


@dataclass(frozen=True)
class FarApart(Region):
    """No peer is nearer than `least_m`."""

    least_m: float

    def margin(self, situation: Situation) -> float:
        own = situation.own
        near_m = (math.hypot(peer.x_m - own.x_m, peer.y_m - own.y_m) for peer in situation.peers)
        return min(near_m, default=1e6) - self.least_m

    def edge_margin(self, safer: Region) -> float:
        return safer.least_m - self.least_m if isinstance(safer, FarApart) else -math.inf


def declare_far(kit: ModuleKit, options: FarOptions) -> RTAModule:
    """Declare a module that keeps robots far apart; its safe controller stands."""
    stand = kit.go_to(lambda situation: (situation.own.x_m, situation.own.y_m))
    safe = FarApart(options.far_m)
    safer = replace(safe, least_m=options.far_m + options.spare_m)
    return RTAModule(kit.name, kit.ac, stand, 2.0 * kit.tick_s, safe, safer, PairBound(kit.model, kit.peer_model))


class KeepOutOptions(_Options):
    """Options of `declare_keep_out`: a disc.

    Attributes:
        x_m: its centre, east.
        y_m: its centre, north.
        radius_m: phi_safe: the disc's radius.
        spare_m: how much more phi_safer requires.
        ahead: whether its safe controller prefers places ahead, on whichever side of the disc they are.
    """

    x_m: float
    y_m: float
    radius_m: float
    spare_m: float
    ahead: bool = False


@dataclass(frozen=True)
class Outside(Region):
    """The robot's centre is at least `least_m` from a point."""

    x_m: float
    y_m: float
    least_m: float

    def margin(self, situation: Situation) -> float:
        return math.hypot(situation.own.x_m - self.x_m, situation.own.y_m - self.y_m) - self.least_m

    def edge_margin(self, safer: Region) -> float:
        return safer.least_m - self.least_m if isinstance(safer, Outside) else -math.inf


def declare_keep_out(kit: ModuleKit, options: KeepOutOptions) -> RTAModule:
    """Declare a module that keeps robots out of a disc; its safe controller drives away from it."""
    safe = Outside(options.x_m, options.y_m, options.radius_m)
    safer = replace(safe, least_m=options.radius_m + options.spare_m)

    def away(situation: Situation) -> tuple[float, float]:
        off_x, off_y = situation.own.x_m - options.x_m, situation.own.y_m - options.y_m

        def fits(x_m: float, y_m: float) -> bool:
            there_x, there_y = x_m - options.x_m, y_m - options.y_m
            leads_away = options.ahead or (there_x - off_x) * off_x + (there_y - off_y) * off_y >= 0.0
            return leads_away and math.hypot(there_x, there_y) >= safer.least_m + 0.1

        return kit.place_ahead(situation, fits)

    return RTAModule(kit.name, kit.ac, kit.go_to(away), 2.0 * kit.tick_s, safe, safer, kit.model)
