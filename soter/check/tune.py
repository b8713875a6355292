"""Finds the least restrictive numbers with which a mission's safety modules are well-formed on its robots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Final, get_args

from soter.check.admission import admit, declare_all
from soter.check.conditions import Finding
from soter.config import MissionFile
from soter.config.tables import MotionModel
from soter.errors import IllFormedModule
from soter.geometry.workspace import Workspace
from soter.rta import DirectedReach, Motion, PairBound, ReachModel, RTAModule, SpeedBound, Timing
from soter.sdk import Capabilities, Link, RobotState
from soter.specs import promises_of
from soter.stack.declaration import GEOFENCE, OBSTACLE, Declared
from soter.stack.right_of_way import BATTERY, COLLISION

SAFER: Final = {COLLISION: "phi_safer_m", OBSTACLE: "phi_safer_m", GEOFENCE: "phi_safer_inset_m"}
"""By module that keeps a distance, the key of the distance of phi_safer."""

MOST_TICKS: Final = 40
"""Longest Delta that is tried, in base ticks: if none up to it is well-formed, longer ones are not."""

_TRADE: Final = (2, 4)
"""Multiples of the shortest Delta that are shown beside it, and used if it does not fit."""

_HEADINGS: Final = 8
_FAR_M: Final = 1000.0
_STEP: Final = 1000
"""Numbers are rounded up to one part in this many: to millimetres, and tenths of a percent of a charge."""


@dataclass(frozen=True)
class Choice:
    """Numbers of one module, and their cost on the robot with the highest.

    Attributes:
        model: its reach model; empty for the battery.
        phi_safer: the value in the mission file: metres, or a charge from 0 to 1.
        reach: R(H), the most that the margin can fall, in the margin's unit.
        usual: how far the margin can fall on average over a robot's motions: where the AC usually loses control.
        needed: margin that P3 needs at the edge of phi_safer: R(H), the noise, and `keep` of the safe controller.
        why_not: why the module is ill-formed, or empty.
        would_do_s: the Delta that would do, if Delta is the reason; 0 if not, or not known.
    """

    module: str
    delta_s: float
    model: str
    phi_safer: float
    reach: float = 0.0
    usual: float = 0.0
    needed: float = 0.0
    why_not: str = ""
    would_do_s: float = 0.0

    @property
    def settings(self) -> dict[str, Any]:
        """The keys of the module's table, with these numbers."""
        if self.module == BATTERY:
            return {"delta_s": self.delta_s, "phi_safer": self.phi_safer}
        return {"delta_s": self.delta_s, SAFER[self.module]: self.phi_safer, "model": self.model}


@dataclass(frozen=True)
class Tuning:
    """The numbers found for a mission.

    Attributes:
        mission: the mission with the numbers found.
        today: by module, the numbers that the mission has.
        found: by module, the least restrictive numbers.
        trade: by module, all well-formed numbers that were tried, the least restrictive first.
        refused: why `soter run` would refuse the mission with the numbers found; empty if it would not.
    """

    mission: MissionFile
    today: Mapping[str, Choice]
    found: Mapping[str, Choice]
    trade: Mapping[str, Sequence[Choice]]
    refused: Sequence[Finding] = ()

    def tables(self) -> dict[str, Any]:
        """Return `[rta.MODULE]` of every tuned module, with all keys."""
        rta = self.mission.rta
        return {"rta": {name: getattr(rta, name).model_dump(mode="json") for name in self.found}}

    def changes(self) -> dict[str, Any]:
        """Return the mission's own tables of modules, with the numbers found."""
        given = self.mission.model_dump(mode="json", exclude_unset=True, exclude_none=True, include={"rta"})
        return {"rta": {**given.get("rta", {}), **self.tables()["rta"]}}


def tune(mission: MissionFile) -> Tuning:
    """Find the least restrictive numbers with which a mission is admitted, on robots with their backend's promises.

    It finds Delta, model and phi_safer of the modules that keep distances: Delta and model because the margin can fall
    less within a shorter horizon, phi_safer because P3 asks for no more. For two robots phi_safer is a body's width
    larger, so that one gets past the other before it is taken again. No proof depends on the dwell or on the charge at
    which robots go on; these trade one delay for another and are kept, except for a battery that is ill-formed.

    Raises:
        ConfigError: bad input.
        BackendError: the mission's backend cannot be loaded.
    """
    workspace = mission.read_workspace()
    capabilities = promises_of(mission, workspace)
    if not mission.rta.order:
        raise mission.refusal("rta", "no module is on, so that there is nothing to tune")
    tuning = tune_for(mission, workspace, capabilities)
    # A phi_safer that was too small may now need more room around starts and stations than there is.
    if not tuning.refused:
        promises_of(tuning.mission, tuning.mission.read_workspace())
    return tuning


def tune_for(mission: MissionFile, workspace: Workspace, capabilities: Mapping[int, Capabilities]) -> Tuning:
    """Return `tune` for given promises, by robot id."""
    return _Search(mission, workspace, capabilities).tuning()


def what_would_do(mission: MissionFile) -> Tuning:
    """Return `tune`, after raising the collision separation if no numbers would do otherwise.

    Raises:
        ConfigError: bad input, or the numbers that would do do not fit in the workspace.
        BackendError: the mission's backend cannot be loaded.
    """
    workspace = mission.read_workspace()
    return tune(_apart(mission, workspace, promises_of(mission, workspace)))


def _apart(mission: MissionFile, workspace: Workspace, capabilities: Mapping[int, Capabilities]) -> MissionFile:
    """Return the mission with a separation large enough for the legs of its robots' safe controllers."""
    collision = mission.rta.collision
    if COLLISION not in mission.rta.order:
        return mission
    # The phi_safer that P3 needs is found later.
    far = _separated(mission, collision.phi_safe_m, collision.phi_safe_m + _FAR_M)
    try:
        for made in declare_all(far, workspace, capabilities).values():
            made.module(COLLISION).check(made.timing, mission.base_tick_s)
    except IllFormedModule as failure:
        safe_m = failure.would_do.get("phi_safe_m", collision.phi_safe_m)
        if safe_m > collision.phi_safe_m:
            gap_m = collision.phi_safer_m - collision.phi_safe_m
            return _apart(_separated(mission, safe_m, safe_m + gap_m), workspace, capabilities)
    return mission


def _separated(mission: MissionFile, safe_m: float, safer_m: float) -> MissionFile:
    collision = mission.rta.collision.model_copy(update={"phi_safe_m": safe_m, "phi_safer_m": safer_m})
    return mission.model_copy(update={"rta": mission.rta.model_copy(update={COLLISION: collision})})


def changed(mission: MissionFile, choices: Iterable[Choice]) -> MissionFile:
    """Return the mission with these numbers in it."""
    rta = mission.rta
    tables = {each.module: getattr(rta, each.module).model_copy(update=each.settings) for each in choices}
    return mission.model_copy(update={"rta": rta.model_copy(update=tables)})


class _Search:
    """One search, for robots with given promises."""

    def __init__(self, mission: MissionFile, workspace: Workspace, capabilities: Mapping[int, Capabilities]) -> None:
        self._mission, self._workspace, self._capabilities = mission, workspace, capabilities
        self._names: Final = [name for name in mission.rta.order if name in SAFER]
        # Robots given back as soon as P3 allows would be taken again at their next move towards each other.
        self._parted_m: Final = 2.0 * max(each.body_radius_m for each in capabilities.values())
        self._known: dict[tuple[int, MotionModel], Mapping[str, Choice]] = {}

    def tuning(self) -> Tuning:
        """Return the best numbers of all modules; if they are refused, try the next best of the module at fault."""
        trade = {name: self._ranked(name) for name in self._names}
        left = {name: [*choices] for name, choices in trade.items() if choices}
        while True:
            found = {name: choices[0] for name, choices in left.items()}
            found |= self._battery(found.values())
            mission = changed(self._mission, found.values())
            admission = admit(mission, self._workspace, self._capabilities)
            refused = [each for each in (admission.ill_formed, *admission.unproved) if each is not None]
            other = left.get(refused[0].module) if refused else None
            if other is None or len(other) < 2:
                today = {name: self._today(name) for name in found}
                return Tuning(mission, today, found, trade, refused)
            del other[0]

    def _ranked(self, name: str) -> list[Choice]:
        """Return the well-formed numbers of a module, the least restrictive first.

        With these the AC loses control last, on average; of equal ones, with these it gets control back first.
        """
        found = [each for model in get_args(MotionModel) for each in self._of_model(name, model)]
        return sorted(found, key=lambda each: (each.usual, each.needed, each.delta_s))

    def _of_model(self, name: str, model: MotionModel) -> Iterator[Choice]:
        why_not, ticks = "", 1
        while ticks <= MOST_TICKS:
            shortest = self._least(ticks, model).get(name)
            if shortest is None:
                return
            if not shortest.why_not:
                longer = (self._least(ticks * times, model).get(name) for times in _TRADE)
                yield from (each for each in (shortest, *longer) if each is not None and not each.why_not)
                return
            wanted = math.ceil(shortest.would_do_s / self._mission.base_tick_s - 1e-6)
            # A refusal in the same words at another Delta is not about Delta, unless it says so.
            if wanted <= ticks and shortest.why_not == why_not:
                return
            why_not, ticks = shortest.why_not, max(ticks + 1, wanted)

    def _least(self, ticks: int, model: MotionModel) -> Mapping[str, Choice]:
        """Return choices of a Delta and a model with the least phi_safer, by module; none if robots promise less."""
        if (ticks, model) not in self._known:
            self._known[ticks, model] = self._found(round(ticks * self._mission.base_tick_s, 9), model)
        return self._known[ticks, model]

    def _found(self, delta_s: float, model: MotionModel) -> Mapping[str, Choice]:
        # All modules at once: what one of them needs does not depend on the others' numbers.
        trials = [Choice(name, delta_s, model, self._now(name, SAFER[name])) for name in self._names]
        try:
            declared = self._declared(trials).values()
        except IllFormedModule:
            return {}
        least, most = [], []
        for trial in trials:
            asked = [_asked(made.module(trial.module), made.timing) for made in declared]
            safe_m = self._now(trial.module, "phi_safe_m") if trial.module != GEOFENCE else 0.0
            # The obstacle module itself adds what its safe controller needs to phi_safer.
            safe_m += self._parted_m if trial.module == COLLISION else 0.0
            least.append(replace(trial, phi_safer=_up(safe_m + max(asked_m - kept_m for asked_m, kept_m in asked))))
            most.append(replace(trial, phi_safer=_up(safe_m + max(asked)[0])))
        found = self._costs(least)
        if any(each.why_not for each in found):
            found = [one if not one.why_not else other for one, other in zip(found, self._costs(most), strict=True)]
        return {each.module: each for each in found}

    def _now(self, name: str, key: str) -> Any:
        return getattr(getattr(self._mission.rta, name), key)

    def _today(self, name: str) -> Choice:
        model = "" if name == BATTERY else self._now(name, "model")
        safer = self._now(name, SAFER.get(name, "phi_safer"))
        choice = Choice(name, self._now(name, "delta_s"), model, safer, math.nan, math.nan, math.nan)
        try:
            return self._costs([choice])[0]
        except IllFormedModule as failure:
            return replace(choice, why_not=_reason(failure))

    def _battery(self, others: Iterable[Choice]) -> dict[str, Choice]:
        """Return the battery's numbers: the mission's, with phi_safer raised to the least that P3 allows."""
        if BATTERY not in self._mission.rta.order:
            return {}
        delta_s, phi_safer = self._now(BATTERY, "delta_s"), self._now(BATTERY, "phi_safer")
        choice = self._costs([*others, Choice(BATTERY, delta_s, "", phi_safer)])[-1]
        if choice.why_not and choice.needed <= 1.0:
            choice = self._costs([*others, replace(choice, phi_safer=max(_up(choice.needed), phi_safer))])[-1]
        return {BATTERY: choice}

    def _declared(self, choices: Iterable[Choice]) -> Mapping[int, Declared]:
        return declare_all(changed(self._mission, choices), self._workspace, self._capabilities)

    def _costs(self, choices: Sequence[Choice]) -> list[Choice]:
        """Return choices with their costs on the robot with the highest, and why any are ill-formed."""
        declared = self._declared(choices)
        return [self._cost(choice, declared) for choice in choices]

    def _cost(self, choice: Choice, declared: Mapping[int, Declared]) -> Choice:
        why_not, would_do_s, costs = "", 0.0, []
        for robot_id, made in declared.items():
            module, timing = made.module(choice.module), made.timing
            assert module.model is not None
            horizon_s, (asked, _) = module.horizon_s(timing), _asked(module, timing)
            reach = module.model.bound(horizon_s)
            usual = _usual(module.model, horizon_s, self._capabilities[robot_id].v_max_m_s)
            # The battery's phi_safer is a charge that first has to pay for the longest return path.
            way = choice.phi_safer - module.edge_margin() if choice.module == BATTERY else 0.0
            costs.append((reach, usual + asked - reach, asked + way))
            try:
                module.check(made.timing, self._mission.base_tick_s)
            except IllFormedModule as failure:
                why_not = why_not or _reason(failure)
                would_do_s = max(would_do_s, failure.would_do.get("delta_s", 0.0))
        reach, usual, needed = (max(each) for each in zip(*costs, strict=True))
        return replace(choice, reach=reach, usual=usual, needed=needed, why_not=why_not, would_do_s=would_do_s)


def _asked(module: RTAModule, timing: Timing) -> tuple[float, float]:
    """Return the margin that P3 needs at the edge of phi_safer, and the part of it kept for the safe controller."""
    assert module.model is not None
    assert module.phi_safe is not None
    noise = module.phi_safe.noise(timing.noise_m)
    return module.model.bound(module.horizon_s(timing)) + noise + module.keep, module.keep


def _reason(failure: IllFormedModule) -> str:
    return f"{failure.condition}: {failure.why}"


def _up(value: float) -> float:
    return math.ceil(value * _STEP - 1e-6) / _STEP


def _usual(model: ReachModel, horizon_s: float, v_max_m_s: float) -> float:
    """Return the mean fall of a margin: over headings, at rest, at half and at top speed."""
    if isinstance(model, DirectedReach):
        own = _extents(model.own, horizon_s, v_max_m_s)
        if model.other is None:
            return sum(own) / len(own)
        pairs = [2.0 * max(pair) for pair in product(own, _extents(model.other, horizon_s, v_max_m_s))]
        return sum(pairs) / len(pairs)
    if isinstance(model, Motion) and not isinstance(model, SpeedBound | PairBound):
        own = _extents(model, horizon_s, v_max_m_s)
        return sum(own) / len(own)
    return model.bound(horizon_s)


def _extents(motion: Motion, horizon_s: float, v_max_m_s: float) -> list[float]:
    """Return how far a robot gets towards the east, for each of its sampled motions."""
    ways = product((0.0, v_max_m_s / 2.0, v_max_m_s), range(_HEADINGS))
    return [motion.extent(_moving(speed, math.tau * turn / _HEADINGS), horizon_s, 1.0, 0.0) for speed, turn in ways]


def _moving(speed_m_s: float, heading_rad: float) -> RobotState:
    vx_m_s, vy_m_s = speed_m_s * math.cos(heading_rad), speed_m_s * math.sin(heading_rad)
    return RobotState(1, 0.0, 0.0, 0.0, 0.0, 0.0, heading_rad, vx_m_s, vy_m_s, 0.0, 1.0, None, None, Link.UP)
