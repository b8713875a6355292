"""Safety modules of the user's own: found by name, declared from a kit, no matter which robot they guard."""

from __future__ import annotations

import copy
import inspect
import math
import typing
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from pydantic import BaseModel

from soter.config import MissionFile, validate_options
from soter.config.tables import UserModuleTable
from soter.errors import ConfigError, IllFormedModule
from soter.geometry.workspace import Workspace
from soter.loading import load_named
from soter.rta import Node, RTAModule, Situation, SpeedBound, Timing, Topic
from soter.sdk import Capabilities, Waypoint
from soter.stack.battery import Dock, GoHome
from soter.stack.recovery import RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.safe_controller import WAYPOINT, SafeController
from soter.stack.terrain import Point, Terrain

BLOCKED_S: Final = 5.0
"""A robot that has stood still for so long beside another is blocked by it."""

RETREAT_M: Final = 0.75
TURN_S: Final = 20.0
"""Robots under a rule about pairs take turns in giving way when it has had them for so long."""

LETS_GO_S: Final = 30.0
"""A module that says nothing else lets go after so long, while the battery's module needs to drive."""

_STEP_M: Final = 0.1


@dataclass(frozen=True)
class ModuleKit:
    """What a module of the user's own is made from: one robot and its world.

    Attributes:
        name: the module's name in the mission; the declaration gets it whatever it calls itself.
        robot_id: which robot it guards.
        capabilities: what that robot promises.
        workspace: fence, boxes, chargers.
        terrain: the same, as distances.
        ac: the AC's node.
        waypoint: where the module's safe controller publishes where to go, as far away as it likes, or None to hold.
        recovery: certified motions; what the safe controller publishes is driven by them in any case.
        refuges: finds places that are safer for every static rule.
        dock: the robot's charging station.
        home: drives the return path to it, by certified legs.
        model: the robot's speed bound, R(T) of any margin that is a distance to something at rest.
        peer_model: the speed bound that every other robot respects, for a rule about pairs: `PairBound(kit.model,
            kit.peer_model)`.
        timing: what the robot adds to every horizon.
        tick_s: the base tick, a period for nodes.
    """

    name: str
    robot_id: int
    capabilities: Capabilities
    workspace: Workspace
    terrain: Terrain
    ac: Node
    waypoint: Topic[Any]
    recovery: RecoveryPlanner
    refuges: RefugeFinder
    dock: Dock
    home: GoHome
    model: SpeedBound
    peer_model: SpeedBound
    timing: Timing
    tick_s: float

    def place_ahead(self, situation: Situation, fits: Callable[[float, float], bool]) -> Point:
        """Return the nearest place straight ahead that fits; if there is none, less and less ahead, and last behind.

        Args:
            situation: where the robot is, and its heading.
            fits: what else is asked of a place, x and y in metres. It is a refuge for fence and boxes in any case, and
                in sight.

        Returns:
            The place, or where the robot is if there is none.
        """
        own, refuges, terrain = situation.own, self.refuges, self.recovery.terrain
        low_x, low_y, high_x, high_y = terrain.bounds
        for turn in (side * step * math.pi / 8.0 for step in range(9) for side in (1, -1)):
            cos, sin = math.cos(own.heading_rad + turn), math.sin(own.heading_rad + turn)
            for step in range(1, math.ceil(math.hypot(high_x - low_x, high_y - low_y) / _STEP_M)):
                x_m, y_m = own.x_m + step * _STEP_M * cos, own.y_m + step * _STEP_M * sin
                if (
                    fits(x_m, y_m)
                    and terrain.fence_m(x_m, y_m) >= refuges.fence_m
                    and terrain.clearance_m(x_m, y_m) >= refuges.clearance_m
                    and self.recovery.sees(situation, x_m, y_m, refuges.clearance_m)
                ):
                    return x_m, y_m
        return own.x_m, own.y_m

    def go_to(self, choose: Callable[[Situation], Point], speed_m_s: float | None = None) -> Node:
        """Return a safe controller that chooses a place when it takes charge, and goes there; anew if it gets stuck.

        Args:
            choose: returns the place.
            speed_m_s: how fast at most, above 0, or None for the robot's own.

        Raises:
            ValueError: the speed is no speed to drive at: it is seen here, before anything moves.
        """
        Waypoint(0.0, 0.0, speed_m_s=speed_m_s).check()
        return GoTo(self, choose, speed_m_s)


def _moves(situation: Situation, moving_m_s: float) -> bool:
    return math.hypot(situation.own.vx_m_s, situation.own.vy_m_s) > moving_m_s


class GoTo(Node):
    """A node that chooses a place when it takes charge, or has stood for a while; see `ModuleKit.go_to`."""

    name = "go-to"
    publishes = (WAYPOINT,)

    def __init__(self, kit: ModuleKit, choose: Callable[[Situation], Point], speed_m_s: float | None) -> None:
        self.period_s = kit.tick_s
        self._waypoint: Final = kit.waypoint
        self._moving_m_s: Final = kit.capabilities.moving_m_s
        self._choose: Final = choose
        self._speed_m_s: Final = speed_m_s
        self._place: Point = (math.nan, math.nan)
        self._moved_s = 0.0

    def engage(self, situation: Situation) -> None:
        self._place = self._choose(situation)
        self._moved_s = situation.now_s

    def step(self, situation: Situation) -> None:
        if _moves(situation, self._moving_m_s):
            self._moved_s = situation.now_s
        elif situation.now_s - self._moved_s > BLOCKED_S:
            # There may have been no place at all then, or somebody in the way to it.
            self.engage(situation)
        self._waypoint.publish(Waypoint(*self._place, speed_m_s=self._speed_m_s))


class CertifiedController(SafeController):
    """Drives where another node wants to go, but only by legs that keep every rule of the mission's modules.

    Whoever writes a safe controller thinks of one rule. The recovery planner thinks of all: a leg that would break one,
    the module's own included, is shortened or not driven, so that a mistake costs time only. It lets go as its contract
    says: where the robot stands, or the battery's module needs to drive, the return path is driven after `lets_go_s`.

    Args:
        made: the user's declaration.
        kit: what it was made from.
        wanted: where its node publishes.
        waypoint: where the robot's controllers publish.
    """

    def __init__(self, made: RTAModule, kit: ModuleKit, wanted: Topic[Any], waypoint: Topic[Waypoint]) -> None:
        inner = made.sc
        super().__init__(inner.name, inner.period_s, waypoint, kit.recovery)
        self._of_pairs: Final = made.of_pairs
        self._lets_go_s: Final = made.lets_go_s
        self._dock: Final = kit.dock
        self._home: Final = kit.home
        self._kept_since_s = 0.0
        self._homewards = self._kept_from_charging = False
        self.publishes = inner.publishes  # type: ignore[assignment]  # a user's node may publish anything: P1b says so
        self.inner: Final = inner
        self._wanted: Final = wanted
        self._engaged = False
        self._engaged_s = self._moved_s = 0.0
        self._yields = False

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        # What the inner node wanted when it was last in charge is no concern of now.
        self._wanted.value = None
        self._engaged = True
        self._engaged_s = self._moved_s = situation.now_s
        self._yields = self._homewards = False
        if not (self._kept_from_charging and self._dock.wants_charge):
            # A robot that goes to and fro between the battery's module and this one is kept all the time.
            self._kept_since_s = situation.now_s
        self._kept_from_charging = self._dock.wants_charge
        self.inner.engage(situation)

    def motion(self, situation: Situation) -> Waypoint | None:
        if not self._engaged:
            # Whoever drives first at the start of a run takes charge of nobody.
            self.engage(situation)
        self.inner.step(situation)
        wanted = self._wanted.value
        speed_m_s = wanted.speed_m_s if isinstance(wanted, Waypoint) else None
        leg = self._out_of_the_way(situation)
        if leg is None and self._has_to_let_go(situation):
            leg = self._home.leg_home(situation)
        if leg is not None:
            return leg._replace(speed_m_s=speed_m_s)
        if wanted is None:
            return self.recovery.hold(situation)
        if not isinstance(wanted, Waypoint):
            raise TypeError(f"the safe controller '{self.name}' published a {type(wanted).__name__}, not a Waypoint")
        wanted.check()
        leg = self.recovery.towards(situation, [(wanted.x_m, wanted.y_m)])
        return None if leg is None else leg._replace(speed_m_s=wanted.speed_m_s)

    def _has_to_let_go(self, situation: Situation) -> bool:
        """Whether the robot has stood, or the battery's module has waited, for as long as the contract allows."""
        now_s, moves = situation.now_s, _moves(situation, self.recovery.moving_m_s)
        self._kept_from_charging = self._dock.wants_charge
        if not self._homewards and moves and not self._dock.wants_charge:
            self._kept_since_s = now_s
        # Whoever is given way to does not follow, unless it has to charge: the rule would never be content.
        waits = self._of_pairs and now_s - self._engaged_s >= TURN_S and not self._dock.wants_charge
        if waits or now_s - self._kept_since_s <= self._lets_go_s:
            return False
        if not self._homewards:
            self._homewards = True
            self._home.start_anew()
        return True

    def _out_of_the_way(self, situation: Situation) -> Waypoint | None:
        """Return a leg away from the nearest peer, if this robot has to give way to it; None otherwise.

        Two robots whose ways are blocked by each other would stand there for ever, or go to and fro. So one of them
        gives way, the one with the higher id first; safety does not rest on it, since the leg is certified like any
        other. Where the rule is about pairs they take turns, until it is content and the AC gets them back.
        """
        own, now_s = situation.own, situation.now_s
        if _moves(situation, self.recovery.moving_m_s):
            self._moved_s = now_s
        near = min(situation.peers, key=lambda p: math.hypot(p.x_m - own.x_m, p.y_m - own.y_m), default=None)
        if near is None or self._dock.charging(situation):
            return None
        away_x, away_y = own.x_m - near.x_m, own.y_m - near.y_m
        if self._of_pairs:
            turn = int((now_s - self._engaged_s) / TURN_S)
            # Whoever has to charge lets the others try first.
            self._yields = turn > (2 if self._dock.wants_charge else 0) and (own.robot_id > near.robot_id) == (
                turn % 2 == 1
            )
        elif near.robot_id > own.robot_id or math.hypot(away_x, away_y) > RETREAT_M:
            self._yields = False
        elif now_s - self._moved_s > BLOCKED_S:
            self._yields = True
        return self.recovery.away(situation, away_x, away_y, self._dock.path.leads_back) if self._yields else None


def declare_own(mission: MissionFile, table: UserModuleTable, kit: ModuleKit, waypoint: Topic[Any]) -> RTAModule:
    """Return a module of the user's own for one robot, under the name that the mission gives it.

    A function declares it, `declare(kit)` or `declare(kit, options)`; the annotation of the second parameter is the
    model of the options. A declaration that was made beforehand will do too; it is copied for every robot.

    Args:
        mission: for messages.
        table: `[rta.module.NAME]`.
        kit: for the robot.
        waypoint: where the robot's controllers publish.

    Raises:
        ConfigError: there is no such function, it takes other arguments, an option is not allowed, or what it returns
            is no module.
        IllFormedModule: the function itself refuses to declare one.
    """
    key, target, options = f"rta.module.{kit.name}", table.declare, table.options

    def refused(message: str) -> ConfigError:
        return mission.refusal(f"{key}.declare", message)

    function = load_named(target, refused)
    if isinstance(function, RTAModule):
        return _bound(function, target, kit, waypoint, refused)
    if not callable(function):
        raise refused(f"'{target}' is a {type(function).__name__}, allowed: a function that takes a ModuleKit")
    arguments: list[Any] = [kit]
    model = _options_model(function, target, refused)
    if model is not None:
        arguments.append(validate_options(model, options, mission.source, f"{key}.options"))
    elif options:
        raise refused(f"'{target}' takes no options, but `{key}.options` gives {', '.join(options)}")
    try:
        made = function(*arguments)
    except IllFormedModule:
        raise
    except Exception as failure:  # foreign code
        raise refused(f"'{target}' failed: {failure!r}; this is a fault of that function") from failure
    if not isinstance(made, RTAModule):
        raise refused(f"'{target}' returned a {type(made).__name__}, allowed: a soter.rta.RTAModule")
    # The user's safe controller publishes where it wants to go; what the robot gets is certified.
    made = _under_contract(made)
    return replace(made, name=kit.name, sc=CertifiedController(made, kit, kit.waypoint, waypoint))


def _under_contract(made: RTAModule) -> RTAModule:
    return made if math.isfinite(made.lets_go_s) else replace(made, lets_go_s=LETS_GO_S)


def _bound(
    declared: RTAModule, target: str, kit: ModuleKit, waypoint: Topic[Any], refused: Callable[[str], ConfigError]
) -> RTAModule:
    """Return a declaration that was made beforehand, bound to one robot: a copy, since its controller has a state."""
    copied = _under_contract(copy.deepcopy(declared))
    topics = [value for value in vars(copied.sc).values() if isinstance(value, Topic)]
    if len(topics) != 1:
        raise refused(
            f"'{target}' is a declaration whose safe controller has {len(topics)} topics among its attributes, "
            "allowed: one, which it publishes on; or name a function that takes a ModuleKit"
        )
    return replace(copied, name=kit.name, sc=CertifiedController(copied, kit, topics[0], waypoint))


def _options_model(
    function: Callable[..., Any], target: str, refused: Callable[[str], ConfigError]
) -> type[BaseModel] | None:
    """Return the model that a declaring function takes, or None if it takes a kit only."""
    try:
        parameters = list(inspect.signature(function).parameters.values())
        hints = typing.get_type_hints(function)
    except (TypeError, ValueError, NameError) as failure:
        raise refused(f"the arguments of '{target}' cannot be read: {failure}") from failure
    if len(parameters) == 1:
        return None
    model = hints.get(parameters[1].name) if len(parameters) == 2 else None
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        raise refused(f"'{target}' has to be declare(kit) or declare(kit, options: a pydantic model)")
    return model
