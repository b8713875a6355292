"""The decision module that is synthesised from a declaration: AC -> SC before the rule can break, SC -> AC when safe.

The switching logic is figure 2.7 of the thesis with the reading of its prose: from AC to SC when not all of
Reach(s, any controller, 2 Delta) is inside phi_safe; from SC to AC when s is in phi_safer. The horizon also pays for
latency, jitter and the age of the sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from soter.controller import AC, SC
from soter.rta.module import Region, RTAModule, Timing, plain
from soter.rta.monitors import ModuleMonitor
from soter.rta.situation import Situation
from soter.rta.topics import Node, Topic

STARTS: Final = "start"
"""The cause of a module that has been in SC since it was bound."""

BEGINS_S: Final = 2.0
"""How long a module may stay in its initial SC before that counts as having fired."""


class Permission(Protocol):
    """The arbiter's say in giving a robot back to its AC."""

    def permits(self, module: str, situation: Situation, since_s: float) -> bool:
        """Return whether the other robots allow this robot, which the module took then, to go back to its AC now."""


def _looks_around(region: Region) -> bool:
    """Return whether room for a safe controller depends on more than the region's margin."""
    return type(region).leaves_room is not Region.leaves_room


def kept_by_margin(module: RTAModule) -> float:
    """Return by how much the margin has to exceed R(H), so that the safe controller can still move."""
    return 0.0 if module.phi_safe is None or _looks_around(module.phi_safe) else module.keep


class DecisionModule:
    """One declared module, bound to one robot. Starts in SC.

    The first time, it gives control to the AC wherever the AC can be trusted for a whole horizon (margin - noise >=
    R(H)), which is what P3 asks of phi_safer. Only later does it wait for phi_safer, which is a hysteresis for robots
    that have been disengaged, such as "charged to 85 %".

    Args:
        module: the declaration.
        timing: what the robot adds to every horizon.
        base_tick_s: period of the supervisor.
        permission: the arbiter; None if the module alone decides when to give control back.
        safer_alone: for studies: phi_safer alone decides when to give control back, which is safe only if the module
            is well-formed.
        foreign: the module is the user's own code, which may change the situations that it is given.

    Attributes:
        module: the declaration.
        rank: its priority among the robot's modules, 0 for the highest; set by the supervisor.
        mode: AC or SC.
        cause: why it is in SC, in words.
        margin: the margin at the last look.
        reach: R(H) at the last look, with the sample's own age in place of A_max; 0 for a rule given by predicates.
        since_s: fleet time of the last change of mode, or of the first look; infinite before that.
        monitor: the spec monitor and metrics.
    """

    def __init__(
        self,
        module: RTAModule,
        timing: Timing,
        base_tick_s: float,
        permission: Permission | None = None,
        safer_alone: bool = False,
        foreign: bool = False,
    ) -> None:
        self.module: Final = module
        self.name: Final = module.name
        self.every_ticks: Final = max(1, round(module.delta_s / base_tick_s))
        self.rank = 0
        self.mode = SC
        self.cause = STARTS
        self.margin = math.nan
        self.reach = 0.0
        self.since_s = math.inf
        self.delta_s: Final = module.delta_s
        self._permission = permission
        self._safer_alone = safer_alone
        self._foreign = foreign
        self._judged_ok_since_s = math.nan
        self._was_engaged = False
        # Each look adds the sample's own age; the declared horizon has A_max in its place.
        self._look_s = timing.look_s(module.delta_s)
        self._phi_safe = module.phi_safe
        self._model = module.model
        self._keep = module.keep
        self._kept_by_margin = kept_by_margin(module)
        self._looks_around = module.phi_safe is not None and _looks_around(module.phi_safe)
        self._noise = plain(module.phi_safe.noise(timing.noise_m)) if module.phi_safe is not None else 0.0
        unit = "" if module.phi_safe is None else module.phi_safe.unit
        self.monitor: Final = ModuleMonitor(module.model, self._noise, timing.sample_age_s, unit, grows=not foreign)
        self._fixed_reach = (
            plain(module.model.bound(self._look_s))
            if module.model is not None and not module.model.depends_on_state
            else math.nan
        )
        model = module.model
        self._horizon_reach = math.inf if model is None else plain(model.bound(module.horizon_s(timing)))

    def decide(self, situation: Situation) -> bool:
        """Judge the situation; return whether the mode changed. Called every Delta."""
        before, now_s = self.mode, situation.now_s
        seen = situation.copy() if self._foreign else situation
        if before is SC:
            changed = self._give_back(seen)
        elif changed := self._in_danger(seen):
            self.force(now_s, self.cause)
        self.monitor.look(now_s, self.margin, before, self.mode)
        return changed

    def _give_back(self, situation: Situation) -> bool:
        """Give the robot back to its AC if phi_safer has held for long enough; return whether it has."""
        self._follow(situation)
        if not situation.now_s - self._judged_ok_since_s >= self.module.dwell_s - 1e-9:
            return False
        if self._permission is not None and not self._permission.permits(self.name, situation, self.since_s):
            return False
        self.mode = AC
        self.cause = ""
        self.since_s = situation.now_s
        self._was_engaged = True
        self._judged_ok_since_s = math.nan
        return True

    def observe(self, situation: Situation) -> None:
        """Judge the margin between two decisions while in SC, so that a dwell may be shorter than Delta."""
        self._follow(situation.copy() if self._foreign else situation)
        self.monitor.look(situation.now_s, self.margin, self.mode, self.mode)

    def _follow(self, situation: Situation) -> None:
        if self.since_s == math.inf:
            self.since_s = situation.now_s
        if not self._fit_for_ac(situation):
            self._judged_ok_since_s = math.nan
        elif math.isnan(self._judged_ok_since_s):
            self._judged_ok_since_s = situation.now_s

    def begins(self, now_s: float) -> bool:
        """Return whether it is in SC only because every module begins there, which for a while says nothing."""
        return self.mode is SC and self.cause == STARTS and not now_s - self.since_s > BEGINS_S

    def force(self, now_s: float, cause: str) -> None:
        """Go to SC, or stay there and restart the dwell, for a cause other than the margin."""
        if self.mode is AC:
            self.mode = SC
            self.since_s = now_s
        self.cause = cause
        self._judged_ok_since_s = math.nan

    def take(self, now_s: float, cause: str) -> None:
        """Take the robot from its AC because other robots need it, although the margin would let the AC go on."""
        if self.mode is AC:
            self.monitor.to_sc += 1
            self.force(now_s, cause)

    def _in_danger(self, situation: Situation) -> bool:
        phi_safe, model = self._phi_safe, self._model
        if phi_safe is None or model is None:
            return self._predicted_to_fail(situation)
        margin, age_s = phi_safe.margin(situation), situation.age_s
        if type(margin) is not float:
            margin = plain(margin)
        if age_s == 0.0 and self._fixed_reach == self._fixed_reach:
            reach = self._fixed_reach
        else:
            reach = plain(model.reach(situation, self._look_s + age_s))
        self.margin, self.reach = margin, reach
        # Written so that a margin that is not a number counts as danger.
        if margin - self._noise - reach >= self._kept_by_margin and (
            not self._looks_around or self._leaves_room(phi_safe, situation, margin, reach)
        ):
            return False
        self.cause = _shortage(margin, reach + self._noise, self._keep, phi_safe.unit)
        return True

    def _leaves_room(self, phi_safe: Region, situation: Situation, margin: float, reach: float) -> bool:
        """Return whether the safe controller can still move wherever the AC may have taken the robot by then."""
        return self._keep == 0.0 or phi_safe.leaves_room(situation, margin, self._keep, self._noise + reach)

    def _predicted_to_fail(self, situation: Situation) -> bool:
        predicate = self.module.ttf_2delta
        if predicate is None or predicate(situation) is False:
            return False
        self.cause = "may fail within 2 Delta"
        return True

    def _fit_for_ac(self, situation: Situation) -> bool:
        phi_safe, model, safer = self._phi_safe, self._model, self.module.phi_safer
        if phi_safe is None or model is None:
            return self._inside(safer, situation) and not self._predicted_to_fail(situation)
        margin = plain(phi_safe.margin(situation))
        self.margin = margin
        reach = plain(model.reach(situation, self._look_s + situation.age_s))
        self.reach = reach
        sure = margin - self._noise
        trusted = sure - reach >= self._kept_by_margin and (
            not self._looks_around or self._leaves_room(phi_safe, situation, margin, reach)
        )
        if not trusted and not self._safer_alone:
            return False
        if not self._was_engaged and sure >= self._horizon_reach:
            return True
        if isinstance(safer, Region):
            aged = model.bound(situation.age_s) - model.bound(0.0)
            return safer.margin(situation) - self._noise - aged >= 0.0
        return safer(situation) is True

    @staticmethod
    def _inside(safer: object, situation: Situation) -> bool:
        if isinstance(safer, Region):
            return safer.margin(situation) >= 0.0
        return callable(safer) and safer(situation) is True


def _shortage(margin: float, reach: float, keep: float, unit: str) -> str:
    """Return, in words, what a margin falls short of, with so many digits that the numbers show it."""
    enough = reach + keep if margin >= reach else reach
    digits = next((each for each in range(3, 9) if f"{margin:.{each}f}" != f"{enough:.{each}f}"), 3)
    has, needs, moves, keeps = (f"{each:.{digits}f} {unit}" for each in (margin, enough, reach, keep))
    if enough == reach:
        return f"margin {has} < reach {moves}"
    return f"margin {has} < {needs}: reach {moves}, and {keeps} for its safe controller"


@dataclass(frozen=True)
class Drivers:
    """The controllers that may drive one robot.

    Attributes:
        modules: in order of priority; the first one that is in SC drives.
        ac: the forwarder of the AC's port.
        waypoint: the topic that AC and SCs publish.
        without_ac: the name of the module that drives once the AC has failed for good and no other module needs to; the
            first module if no module has this name.
    """

    modules: Sequence[DecisionModule]
    ac: Node
    waypoint: Topic[Any]
    without_ac: str = ""
