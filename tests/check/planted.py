"""Modules of a user's own for an open floor of 6 x 6 m: keep east of 1 m. One is right; the others are not.

Every bug is one that somebody might make.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pydantic import BaseModel, model_validator

from soter.campaign.random.attackers import FarOptions, declare_far
from soter.rta import Node, PairBound, Region, RTAModule, Situation, SpeedBound, Topic
from soter.sdk import Waypoint
from soter.stack.actuator import PortForwarder
from soter.stack.module_kit import ModuleKit

DELTA_S = 0.5
V_M_S = 0.22
STOP_M = V_M_S**2 / 2.0
HORIZON_S = 2.0 * DELTA_S + 0.1
REACH_M = V_M_S * HORIZON_S + STOP_M

Motion = Callable[[Situation], Waypoint | None]


@dataclass(frozen=True)
class EastOf(Region):
    least_m: float = 1.0

    def margin(self, situation: Situation) -> float:
        return situation.own.x_m - self.least_m

    def edge_margin(self, safer: Region) -> float:
        assert isinstance(safer, EastOf)
        return safer.least_m - self.least_m


@dataclass(frozen=True)
class EastOrSlow(EastOf):
    """West of 1 m it is enough to be slow."""

    def margin(self, situation: Situation) -> float:
        own = situation.own
        return max(own.x_m - self.least_m, 0.1 * (0.15 - math.hypot(own.vx_m_s, own.vy_m_s)))


@dataclass(frozen=True)
class Later(EastOf):
    """Grows with time."""

    def margin(self, situation: Situation) -> float:
        return super().margin(situation) - 0.001 * situation.now_s


@dataclass(frozen=True)
class UnknownWhenFast(EastOf):
    """Says nothing of a robot that is fast in the north, away from where it starts."""

    def margin(self, situation: Situation) -> float:
        own = situation.own
        fast = math.hypot(own.vx_m_s, own.vy_m_s) > 0.12
        return math.nan if fast and own.y_m > 3.5 else super().margin(situation)


@dataclass(frozen=True)
class WestOf(Region):
    most_m: float

    def margin(self, situation: Situation) -> float:
        return self.most_m - situation.own.x_m

    def edge_margin(self, safer: Region) -> float:
        assert isinstance(safer, WestOf)
        return self.most_m - safer.most_m


class Controller(Node):
    """Publishes where a function wants to go."""

    name = "sc"
    publishes: tuple[str, ...] = ("waypoint",)

    def __init__(self, topic: Topic[Waypoint], motion: Motion, period_s: float = 0.05) -> None:
        self.topic, self.motion, self.period_s = topic, motion, period_s

    def step(self, situation: Situation) -> None:
        self.topic.publish(self.motion(situation))


def east(situation: Situation) -> Waypoint:
    return Waypoint(3.0, situation.own.y_m)


def west(situation: Situation) -> Waypoint:
    return Waypoint(0.0, situation.own.y_m)


def hold(situation: Situation) -> None:
    return None


def nearly_back(situation: Situation) -> Waypoint:
    return Waypoint(1.3, situation.own.y_m)


def fails_in_a_corner(situation: Situation) -> Waypoint | None:
    return None if situation.own.y_m < 0.6 else east(situation)


def wrong_way_when_deep(situation: Situation) -> Waypoint:
    """Deeper than most ACs get: only one that is fast, and lucky with the moment at which the module looks."""
    return west(situation) if situation.own.x_m < 1.15 else east(situation)


def raises(situation: Situation) -> Waypoint:
    raise KeyError("no such table")


def _made(kit: ModuleKit, motion: Motion) -> RTAModule:
    sc = Controller(kit.waypoint, motion)
    return RTAModule(kit.name, kit.ac, sc, DELTA_S, EastOf(), EastOf(1.0 + REACH_M + 0.1), kit.model)


def right(kit: ModuleKit) -> RTAModule:
    return _made(kit, east)


def beside_the_fence(kit: ModuleKit) -> RTAModule:
    """Gives robots back only where the geofence module does not."""
    return replace(_made(kit, west), phi_safe=WestOf(0.55), phi_safer=WestOf(0.42 - REACH_M))


def grows_with_time(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), phi_safe=Later(), phi_safer=Later(1.0 + REACH_M + 0.1))


def says_nothing_of_fast_robots(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), phi_safe=UnknownWhenFast())


def sc_holds_where_the_mission_begins(kit: ModuleKit) -> RTAModule:
    """Fails in a place that hardly any drawn trial begins in."""

    def motion(situation: Situation) -> Waypoint | None:
        at = situation.own.x_m, situation.own.y_m
        return None if math.dist(at, (1.5, 1.5)) < 0.01 else east(situation)

    return replace(_made(kit, motion), phi_safe=EastOf(1.4999), phi_safer=EastOf(1.4999 + REACH_M + 0.1))


def holds_for_ever(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), lets_go_s=1e6)


def sc_leaves(kit: ModuleKit) -> RTAModule:
    return _made(kit, west)


def sc_speeds(kit: ModuleKit) -> RTAModule:
    """Goes where it may be, and then faster than it may be there."""
    return replace(_made(kit, west), phi_safe=EastOrSlow(), phi_safer=EastOrSlow(1.0 + REACH_M + 0.1))


def sc_speeds_rarely(kit: ModuleKit) -> RTAModule:
    return replace(sc_speeds(kit), sc=_made(kit, wrong_way_when_deep).sc)


def sc_holds(kit: ModuleKit) -> RTAModule:
    return _made(kit, hold)


def sc_stops_short(kit: ModuleKit) -> RTAModule:
    return _made(kit, nearly_back)


def sc_fails_in_a_corner(kit: ModuleKit) -> RTAModule:
    return _made(kit, fails_in_a_corner)


def sc_raises(kit: ModuleKit) -> RTAModule:
    return _made(kit, raises)


def sc_publishes_nonsense(kit: ModuleKit) -> RTAModule:
    return _made(kit, lambda situation: Waypoint(math.nan, situation.own.y_m))


def sc_passes_the_kit_by(kit: ModuleKit) -> RTAModule:
    """Publishes on the robot's own topic."""
    assert isinstance(kit.ac, PortForwarder)
    return replace(right(kit), sc=Controller(kit.ac.waypoint, east))


def sc_cannot_choose(kit: ModuleKit) -> RTAModule:
    def choose(situation: Situation) -> tuple[float, float]:
        raise RuntimeError("nowhere to go")

    return replace(right(kit), sc=kit.go_to(choose))


def sc_raises_in_a_corner(kit: ModuleKit) -> RTAModule:
    return _made(kit, lambda situation: raises(situation) if situation.own.y_m < 1.5 else east(situation))


def exchanged(kit: ModuleKit) -> RTAModule:
    """AC and SC have changed places."""
    made = right(kit)
    return replace(made, ac=made.sc, sc=kit.ac)


class Silent(Controller):
    def step(self, situation: Situation) -> None:
        pass


def sc_publishes_nothing(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), sc=Silent(kit.waypoint, hold), lets_go_s=4.0)


def sc_publishes_none(kit: ModuleKit) -> RTAModule:
    return replace(_made(kit, hold), lets_go_s=4.0)


def sc_stays_where_it_is(kit: ModuleKit) -> RTAModule:
    return replace(_made(kit, lambda situation: Waypoint(situation.own.x_m, situation.own.y_m)), lets_go_s=4.0)


def sc_stays_in_the_south(kit: ModuleKit) -> RTAModule:
    def motion(situation: Situation) -> Waypoint | None:
        return None if situation.own.y_m < 3.0 else east(situation)

    return replace(_made(kit, motion), lets_go_s=4.0)


def sc_takes_long(kit: ModuleKit) -> RTAModule:
    """Comes back by itself, for longer than its contract says of robots that stand."""
    return replace(_made(kit, lambda situation: east(situation)._replace(speed_m_s=0.05)), lets_go_s=4.0)


def sc_is_slow(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), sc=Controller(kit.waypoint, east, period_s=1.0))


def sc_publishes_elsewhere(kit: ModuleKit) -> RTAModule:
    sc = Controller(kit.waypoint, east)
    sc.publishes = ("cmd_vel",)
    return replace(right(kit), sc=sc)


def safer_too_near(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), phi_safer=EastOf(1.0 + REACH_M - 0.05))


def lying_model(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), model=SpeedBound(0.05, 1.0))


def _predicates(kit: ModuleKit, looks_s: float, safer_m: float) -> RTAModule:
    def soon(situation: Situation) -> bool:
        return situation.own.x_m - 1.0 < V_M_S * looks_s + STOP_M

    def safer(situation: Situation) -> bool:
        return situation.own.x_m - 1.0 >= safer_m

    sc = Controller(kit.waypoint, east)
    return RTAModule(kit.name, kit.ac, sc, DELTA_S, EastOf(), safer, ttf_2delta=soon)


def predicates(kit: ModuleKit) -> RTAModule:
    return _predicates(kit, HORIZON_S, REACH_M)


def looks_one_delta(kit: ModuleKit) -> RTAModule:
    """Half of what it has to look ahead, and no room for stopping: it fires when it is too late."""

    def soon(situation: Situation) -> bool:
        return situation.own.x_m - 1.0 < V_M_S * DELTA_S

    return replace(_predicates(kit, 0.0, REACH_M), ttf_2delta=soon)


def never_looks(kit: ModuleKit) -> RTAModule:
    return replace(_predicates(kit, 0.0, REACH_M), ttf_2delta=lambda situation: False)


def without_a_region(kit: ModuleKit) -> RTAModule:
    return replace(predicates(kit), phi_safe=None)


class Options(BaseModel, extra="forbid", frozen=True):
    least_m: float


class Anything(BaseModel, extra="allow"):
    pass


def with_options(kit: ModuleKit, options: Options) -> RTAModule:
    return replace(right(kit), phi_safe=EastOf(options.least_m), phi_safer=EastOf(options.least_m + 0.5))


def without_sc(kit: ModuleKit, _: Anything) -> RTAModule:
    return replace(right(kit), sc=None)  # type: ignore[arg-type]


class Unchecked(BaseModel, extra="allow"):
    """Its own check fails by what is no sign of a bad value."""

    @model_validator(mode="before")
    @classmethod
    def _fails(cls, _: object) -> object:
        raise KeyError("no table")


def with_unchecked_options(kit: ModuleKit, options: Unchecked) -> RTAModule:
    return right(kit)


_TOPIC: Topic[Waypoint] = Topic("waypoint")
_SC = Controller(_TOPIC, east)
DECLARED = RTAModule("east", _SC, _SC, DELTA_S, EastOf(), EastOf(1.5), SpeedBound(V_M_S, 1.0))
"""A declaration that was made beforehand."""

NOT_A_MODULE = 3


def wrong_type(kit: ModuleKit) -> int:
    return 3


def broken(kit: ModuleKit) -> RTAModule:
    raise RuntimeError("I am broken")


def too_many(kit: ModuleKit, options: Options, more: int) -> RTAModule:
    return right(kit)


@dataclass(frozen=True)
class Unheard(EastOf):
    """A rule that fails wherever it is asked."""

    def margin(self, situation: Situation) -> float:
        raise KeyError("no map here")


def adds_to_the_margin(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), keep=-5.0)


def hardly_ever(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), delta_s=1e9)


def unheard(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), phi_safe=Unheard())


def unheard_where_it_is_safer(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), phi_safer=Unheard(1.5))


def of_equals(kit: ModuleKit) -> RTAModule:
    """A rule about pairs whose peers are taken for robots like its own."""
    made = right(kit)
    return replace(made, model=PairBound(kit.model, kit.model))


@dataclass(frozen=True)
class Apart(Region):
    """0.5 m from every other robot."""

    least_m: float = 0.5

    def margin(self, situation: Situation) -> float:
        own = situation.own
        away_m = [math.hypot(each.x_m - own.x_m, each.y_m - own.y_m) for each in situation.peers]
        return min(away_m, default=9.0) - self.least_m

    def edge_margin(self, safer: Region) -> float:
        return safer.least_m - self.least_m if isinstance(safer, Apart) else math.nan


def alone(kit: ModuleKit) -> RTAModule:
    """A rule about pairs under a model of one robot."""
    return replace(right(kit), phi_safe=Apart(), phi_safer=Apart(1.0))


def of_two(kit: ModuleKit) -> RTAModule:
    """A rule about pairs, of an author who has not thought of one robot."""
    if len(kit.workspace.robots) < 2:
        raise ValueError("it takes two")
    return declare_far(kit, FarOptions(far_m=1.0, spare_m=0.6))
