"""The wrapper for a safe controller that does not drive by certified legs itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from soter.rta import RTAModule, Situation, Topic
from soter.sdk import Waypoint
from soter.stack.module_kit import BLOCKED_S, ModuleKit
from soter.stack.recovery import Leg
from soter.stack.safe_controller import SafeController

RETREAT_M: Final = 0.75
TURN_S: Final = 20.0
"""Once a rule about pairs has held robots for this long, they take turns in giving way."""


class CertifiedController(SafeController):
    """Drives where another node wants to go, but only by legs that keep every rule of the mission's modules.

    The author of a safe controller thinks of one rule; the recovery planner checks all. A leg that would break one, the
    module's own included, is shortened or not driven, so that a mistake only costs time. The controller keeps its
    contract: if the robot stands, or the battery's module needs to drive, it drives the return path after `lets_go_s`.

    Trials ask what it did for the other node.

    Attributes:
        failure: the first failure of the other node: what it raised, or what is wrong with what it published.
        driven_there: whether it has driven where the other node wants to go, since it last took control.
        driven_home: whether it has driven the return path, likewise.
    """

    def __init__(self, made: RTAModule, kit: ModuleKit, wanted: Topic[Any], waypoint: Topic[Any]) -> None:
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
        self._drove_s = -math.inf
        self._yields = False
        self.failure: BaseException | None = None
        self.driven_there = self.driven_home = False

    def engage(self, situation: Situation) -> None:
        super().engage(situation)
        # Drop what the inner node wanted the last time it was active.
        self._wanted.value = None
        self._engaged = True
        if situation.now_s - self._drove_s > TURN_S:
            # A rule that takes the robot again at once was not satisfied: the turns go on.
            self._engaged_s = situation.now_s
        self._moved_s = situation.now_s
        self._yields = self._homewards = self.driven_there = self.driven_home = False
        if not (self._kept_from_charging and self._dock.wants_charge):
            # A robot that switches between the battery's module and this one counts as kept all the time.
            self._kept_since_s = situation.now_s
        self._kept_from_charging = self._dock.wants_charge
        with self._only_wishes():
            self.inner.engage(situation.copy())

    def motion(self, situation: Situation) -> Leg | None:
        if not self._engaged:
            # The first driver of a run is never engaged by a switch.
            self.engage(situation)
        self._drove_s = situation.now_s
        wanted, failure = self._ask(situation)
        leg = self._out_of_the_way(situation)
        if leg is None and self._has_to_let_go(situation):
            leg = self._home.leg_home(situation)
            self.driven_home = self.driven_home or leg is not None
        if leg is not None:
            return leg if wanted is None else leg._replace(speed_m_s=wanted.speed_m_s)
        if failure is not None:
            raise failure
        if wanted is None:
            return self.recovery.hold(situation)
        leg = self.recovery.towards(situation, [(wanted.x_m, wanted.y_m)])
        if leg is None:
            return None
        self.driven_there = True
        return leg._replace(speed_m_s=wanted.speed_m_s)

    def _ask(self, situation: Situation) -> tuple[Waypoint | None, BaseException | None]:
        """Return where the inner node wants to go, and what it raised: its contract is kept whatever it does."""
        try:
            with self._only_wishes():
                self.inner.step(situation.copy())
            wanted = self._wanted.value
            if wanted is not None and not isinstance(wanted, Waypoint):
                raise TypeError(
                    f"the safe controller '{self.name}' published a {type(wanted).__name__}, not a Waypoint"
                )
            if wanted is not None:
                wanted.check()
        except KeyboardInterrupt:
            raise
        except BaseException as failure:  # noqa: BLE001 - foreign code
            self._note(failure)
            return None, failure
        return wanted, None

    def _note(self, failure: BaseException) -> None:
        if self.failure is None:
            self.failure = failure

    @contextmanager
    def _only_wishes(self) -> Iterator[None]:
        """Refuse what the inner node publishes past this one: nobody has certified it."""
        before = self.waypoint.count
        try:
            yield
            if self.waypoint.count != before:
                raise PermissionError(
                    f"the safe controller '{self.name}' published on the robot's own topic, not the kit's"
                )
        except BaseException as failure:
            self._note(failure)
            raise

    def _has_to_let_go(self, situation: Situation) -> bool:
        """Return whether the robot has stood, or the battery's module has waited, as long as the contract allows."""
        now_s, moves = situation.now_s, self.recovery.moves(situation.own)
        self._kept_from_charging = self._dock.wants_charge
        if not self._homewards and moves and not self._dock.wants_charge:
            self._kept_since_s = now_s
        # A robot that is given way to does not follow, unless it has to charge: the rule would never be satisfied.
        waits = self._of_pairs and now_s - self._engaged_s >= TURN_S and not self._dock.wants_charge
        if waits or now_s - self._kept_since_s <= self._lets_go_s:
            return False
        if not self._homewards:
            self._homewards = True
            self._home.start_anew()
        return True

    def _out_of_the_way(self, situation: Situation) -> Leg | None:
        """Return a leg away from the nearest peer, if this robot has to give way to it; None otherwise.

        Two robots that block each other would stand there for ever, or go to and fro. So one of them gives way, the one
        with the higher id first; safety does not rest on it, since the leg is certified like any other. Under a rule
        about pairs they take turns, until it is satisfied and the ACs get them back.
        """
        own, now_s = situation.own, situation.now_s
        if self.recovery.moves(situation.own):
            self._moved_s = now_s
        near = min(situation.peers, key=lambda p: math.hypot(p.x_m - own.x_m, p.y_m - own.y_m), default=None)
        if near is None or self._dock.charging(situation):
            return None
        away_x, away_y = own.x_m - near.x_m, own.y_m - near.y_m
        if self._of_pairs:
            # A robot that has to charge lets the others try first. Turns follow fleet time, one for each robot.
            waited = now_s - self._engaged_s >= TURN_S * (3.0 if self._dock.wants_charge else 1.0)
            self._yields = waited and (own.robot_id > near.robot_id) == (int(now_s / TURN_S) % 2 == 1)
        elif near.robot_id > own.robot_id or math.hypot(away_x, away_y) > RETREAT_M:
            self._yields = False
        elif now_s - self._moved_s > BLOCKED_S:
            self._yields = True
        return self.recovery.away(situation, away_x, away_y, self._dock.path.leads_back) if self._yields else None
