"""Monitors: of a module's rule and reach model, and of the assumptions about robots and peers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from soter.controller import SC, Controller
from soter.rta.assumptions import Assumption
from soter.rta.models import ReachModel
from soter.rta.module import Timing
from soter.rta.situation import Sample

AHEAD_S: Final = 0.1
"""How far a stamp may be ahead of fleet time before its clock counts as wrong instead of slightly fast."""

_AT_SPEED: Final = 0.95
_UNSURE: Final = 0.1
_REST_M_S: Final = 0.02
_ROUNDING_M_S: Final = 1e-6
_ROUNDING_M: Final = 1e-6
ROUNDING_S: Final = 1e-9


class BrokenAssumption(NamedTuple):
    """An assumption that was seen not to hold, and what was seen.

    Attributes:
        assumption: the one that failed.
        cause: what was seen, in words.
        excess: by how much the observed value exceeded the assumed one; NaN if that cannot be measured.
        unit: unit of the excess.
    """

    assumption: Assumption
    cause: str
    excess: float = math.nan
    unit: str = ""


@dataclass(slots=True, eq=False)
class ModuleMonitor:
    """Monitors one decision module: does its invariant hold, and does its model fit the robot?

    The invariant, as the decision module sees it: the margin is never negative. The model: between two looks the
    margin never falls by more than R(elapsed). Neither shows that a run was safe, which only ground truth can; a
    failure of either shows that the proof's assumptions do not fit the robot.

    Args:
        model: R(T), or None for a rule given by predicates; then only decisions are counted.
        noise: by how much the margin may be wrong.
        sample_age_s: by how much longer the time between two samples may be than that between two looks.
        unit: of the margin.
        grows: whether R(T) is known to grow with T, so that a fall of less than R(0) needs no closer look; a model of a
            user's own may not.

    Attributes:
        looks: how often the margin was judged.
        to_sc: changes AC -> SC.
        to_ac: changes SC -> AC.
        sc_s: time spent in SC, up to the last look.
        least_margin: the least margin seen.
        broken: looks at which the margin was negative or no number.
        surprises: looks at which the margin had fallen by more than the model allows.
        found: the assumption that failed at the last look; the supervisor sets it back to None.
    """

    model: ReachModel | None
    noise: float = 0.0
    sample_age_s: float = 0.0
    unit: str = "m"
    grows: bool = False
    looks: int = field(default=0, init=False)
    to_sc: int = field(default=0, init=False)
    to_ac: int = field(default=0, init=False)
    sc_s: float = field(default=0.0, init=False)
    least_margin: float = field(default=math.inf, init=False)
    broken: int = field(default=0, init=False)
    surprises: int = field(default=0, init=False)
    found: BrokenAssumption | None = field(default=None, init=False)
    _last_margin: float = field(default=math.nan, init=False)
    _last_s: float = field(default=math.nan, init=False)
    _at_once: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if self.model is not None and self.grows:
            self._at_once = self._fall_at_most(0.0, self.model)

    def look(self, now_s: float, margin: float, before: Controller, after: Controller) -> None:
        """Record one look of the decision module."""
        self.looks += 1
        if before is not after:
            if after is SC:
                self.to_sc += 1
            else:
                self.to_ac += 1
        model = self.model
        if model is None:
            return
        if before is SC and now_s > self._last_s:
            self.sc_s += now_s - self._last_s
        if margin < self.least_margin:
            self.least_margin = margin
        fall = self._last_margin - margin
        # Written so that NaN counts as broken.
        if not margin >= 0.0:
            self.broken += 1
            if -math.inf < margin < -self.noise:
                first = math.isnan(self._last_margin)
                assumption = Assumption.START if first else Assumption.RECOVERY
                self.found = BrokenAssumption(assumption, f"margin {margin:.3f}", -margin, self.unit)
        if self._at_once < fall < math.inf and fall > (most := self._fall_at_most(now_s - self._last_s, model)):
            self.surprises += 1
            if not model.of_pairs and self._last_margin >= 0.0:
                # The samples are tested on their own: where they are right, it is the world that has changed, or the
                # margin falls faster than its model says. Where that broke the rule, no safe controller could help.
                cause = f"the margin fell by {fall:.3f} within {now_s - self._last_s:.3f} s"
                self.found = BrokenAssumption(Assumption.WORKSPACE, cause, fall - most, self.unit)
        self._last_margin, self._last_s = margin, now_s

    def _fall_at_most(self, elapsed_s: float, model: ReachModel) -> float:
        return model.bound(max(0.0, elapsed_s) + self.sample_age_s) + 2.0 * self.noise


@dataclass(frozen=True)
class Assumed:
    """What is assumed of one robot; every sample is tested against it.

    Attributes:
        models: reach models that bound its motion.
        timing: its declared timing.
        heard_within_s: largest age of a sample at which the lease is still renewed.
    """

    models: Sequence[ReachModel]
    timing: Timing
    heard_within_s: float = math.inf


class SampleMonitor:
    """Tests every sample of one robot against the clock, the declared age, and the sample before it."""

    def __init__(self, models: Sequence[ReachModel], timing: Timing) -> None:
        self._models: Final = tuple(models)
        self._sample_age_s: Final = timing.sample_age_s
        self._noise_m: Final = timing.noise_m

    def look(self, now_s: float, before: Sample, sample: Sample) -> BrokenAssumption | None:
        """Return what is wrong with a sample that was read at fleet time `now_s`, or None."""
        stamp_s, most_s = sample.stamp_s, self._sample_age_s
        age_s = now_s - stamp_s
        if age_s > most_s + ROUNDING_S:
            cause = f"sample is {age_s:.3f} s old, declared at most {most_s:.3f} s"
            return BrokenAssumption(Assumption.SAMPLE_AGE, cause, age_s - most_s, "s")
        if sample is before:
            return None
        if age_s < -AHEAD_S:
            return BrokenAssumption(
                Assumption.CLOCK, f"sample is stamped {-age_s:.3f} s ahead of the clock", -age_s, "s"
            )
        if stamp_s < before.stamp_s:
            back_s = before.stamp_s - stamp_s
            return BrokenAssumption(Assumption.CLOCK, f"stamps went back by {back_s:.3f} s", back_s, "s")
        for model in self._models:
            if not model.admits(before, sample, self._noise_m):
                return self._outside(model, before, sample)
        return None

    def _outside(self, model: ReachModel, before: Sample, sample: Sample) -> BrokenAssumption:
        cause = f"sample outside the reach set of {type(model).__name__}"
        if model.assumption is not Assumption.MOTION:
            return BrokenAssumption(model.assumption, cause, *model.excess(before, sample, self._noise_m))
        way_m, elapsed_s = _apart_m(before, sample), sample.stamp_s - before.stamp_s
        speed_m_s = max(_speed_m_s(before), _speed_m_s(sample))
        cause += f": {way_m:.3f} m in {elapsed_s:.3f} s at no more than {speed_m_s:.3f} m/s"
        # A robot that is too fast reports a speed that explains the distance; otherwise its position is wrong.
        unexplained_m = way_m - (speed_m_s * elapsed_s + 2.0 * self._noise_m + _ROUNDING_M)
        if unexplained_m > 0.0:
            return BrokenAssumption(Assumption.POSITION_NOISE, cause, unexplained_m, "m")
        return BrokenAssumption(Assumption.MOTION, cause, *model.excess(before, sample, self._noise_m))


class StopMonitor:
    """Monitors that a robot comes to rest in time: no farther than its latency and its braking distance take it.

    It has to when it was told to stop and nothing since, and while its lease is withheld. Once it reports that it has
    begun to brake, its speed has to fall as fast as it promises.

    Args:
        models: reach models of the robot; the first that bounds its motion is used; without one nothing is monitored.
        timing: the robot's declared timing.
    """

    __slots__ = ("_brake_m_s2", "_braking", "_latency_s", "_lease", "_noise_m", "_speed_noise_m_s", "_told")

    def __init__(self, models: Sequence[ReachModel], timing: Timing) -> None:
        model = next((model for model in models if model.assumption is Assumption.MOTION), None)
        self._told: Final = _Order(model, timing.latency_s)
        self._lease: Final = _Order(model, timing.latency_s + timing.lease_s)
        self._noise_m: Final = timing.noise_m
        self._speed_noise_m_s: Final = timing.speed_noise_m_s
        self._latency_s: Final = timing.latency_s
        # A model of the user's own may have no brake.
        self._brake_m_s2: Final[float | None] = getattr(model, "brake_m_s2", None)
        self._braking: Sample | None = None

    def told(self, now_s: float, sample: Sample, stop: bool) -> None:
        """Note that the robot was told to stop, or was given another command."""
        self._told.note(now_s, sample, stop)
        if not stop:
            self._braking = None

    def lease(self, now_s: float, sample: Sample, withheld: bool) -> None:
        """Note whether the lease was withheld."""
        if withheld or self._lease.start is not None:
            self._lease.note(now_s, sample, withheld)

    def look(self, now_s: float, sample: Sample) -> BrokenAssumption | None:
        """Return the assumption that the robot broke by running on, or None."""
        if self._lease.start is None and self._told.start is None:
            return None
        overrun = self._lease.overrun(now_s, sample, self._noise_m)
        if overrun is not None:
            cause, too_far_m = overrun
            return BrokenAssumption(Assumption.LEASE, f"its lease was withheld, and it {cause}", too_far_m, "m")
        weak = self._weak(sample)
        if weak is not None:
            return weak
        start = self._told.start
        overrun = self._told.overrun(now_s, sample, self._noise_m)
        if overrun is None or start is None:
            return None
        cause, too_far_m = overrun
        brakes = _speed_m_s(sample) < _AT_SPEED * _speed_m_s(start)
        assumption = Assumption.BRAKING if brakes else Assumption.LATENCY
        return BrokenAssumption(assumption, f"told to stop, it {cause}", too_far_m, "m")

    def _weak(self, sample: Sample) -> BrokenAssumption | None:
        """Return the broken assumption if a braking robot's speed falls too slowly, or None."""
        start, since, brake_m_s2 = self._told.start, self._braking, self._brake_m_s2
        if start is None or brake_m_s2 is None or sample is since:
            return None
        speed_m_s, began_m_s = _speed_m_s(sample), _speed_m_s(start)
        if since is None:
            if sample.stamp_s >= self._told.ordered_s + self._latency_s and speed_m_s < _AT_SPEED * began_m_s:
                self._braking = sample
            return None
        # Without a promise, reported velocities count as right to within a share, but never better than at rest.
        noise_m_s = self._speed_noise_m_s
        unsure_m_s = max(_UNSURE * began_m_s, _REST_M_S) if noise_m_s is None else 2.0 * noise_m_s
        passed_s = sample.stamp_s - since.stamp_s
        most_m_s = max(0.0, _speed_m_s(since) - brake_m_s2 * passed_s) + unsure_m_s + _ROUNDING_M_S
        if passed_s <= 0.0 or speed_m_s <= most_m_s:
            return None
        # Start over from here, so that one failure is not counted for ever.
        self._braking = sample
        cause = f"told to stop, it still did {speed_m_s:.3f} m/s after {passed_s:.3f} s, at most {most_m_s:.3f} m/s"
        return BrokenAssumption(Assumption.BRAKING, cause, speed_m_s - most_m_s, "m/s")


class _Order:
    """One order to be at rest, and the robot's sample when it was given."""

    __slots__ = ("_model", "_within_s", "ordered_s", "start")

    def __init__(self, model: ReachModel | None, within_s: float) -> None:
        self._model: Final = model
        self._within_s: Final = within_s
        self.ordered_s = 0.0
        self.start: Sample | None = None

    def note(self, now_s: float, sample: Sample, stop: bool) -> None:
        if not stop or self._model is None:
            self.start = None
        elif self.start is None:
            self.start, self.ordered_s = sample, now_s

    def overrun(self, now_s: float, sample: Sample, noise_m: float) -> tuple[str, float] | None:
        """Return how the robot ran on, in words, and how many metres too far; None if it did not."""
        start, model = self.start, self._model
        if start is None or model is None or sample is start:
            return None
        age_s = max(0.0, self.ordered_s - start.stamp_s)
        most_m = model.bound(self._within_s + age_s) + 2.0 * noise_m + _ROUNDING_M
        way_m = _apart_m(start, sample)
        if way_m <= most_m:
            return None
        cause = f"got {way_m:.3f} m farther since {self.ordered_s:.3f} s, at most {most_m:.3f} m"
        # Start over from here: a robot that has come to rest after all must not count for ever.
        self.start, self.ordered_s = sample, now_s
        return cause, way_m - most_m


class PeerMonitor:
    """Tests what peers report of themselves against the bound that they are assumed to respect.

    One for a fleet: all peers hear the same report.

    Args:
        bounds: by robot, the bound that it promises and the largest error of the positions that it reports.
        silent_s: longest time for which a peer may be silent.
    """

    def __init__(self, bounds: Mapping[int, tuple[ReachModel, float]], silent_s: float) -> None:
        self._bounds: Final = bounds
        self._silent_s: Final = silent_s
        self._before: dict[int, Sample] = {}

    def look(self, now_s: float, samples: Sequence[Sample]) -> dict[int, BrokenAssumption]:
        """Return the broken assumptions, by the id of the robot that broke them."""
        before, found = self._before, {}
        for sample in samples:
            robot_id = sample.robot_id
            last = before.get(robot_id)
            if sample is not last:
                before[robot_id] = sample
                model, noise_m = self._bounds[robot_id]
                if last is not None and not model.admits(last, sample, noise_m):
                    cause = f"robot {robot_id}: sample outside the reach set that it promises to its peers"
                    excess = model.excess(last, sample, noise_m)
                    found[robot_id] = BrokenAssumption(Assumption.PEERS, cause, *excess)
                    continue
            silent_s = now_s - sample.stamp_s
            if silent_s > self._silent_s + ROUNDING_S:
                cause = f"robot {robot_id}: not heard of for {silent_s:.3f} s"
                found[robot_id] = BrokenAssumption(Assumption.PEERS, cause, silent_s - self._silent_s, "s")
        return found


def _apart_m(one: Sample, other: Sample) -> float:
    return math.hypot(other.x_m - one.x_m, other.y_m - one.y_m)


def _speed_m_s(sample: Sample) -> float:
    return math.hypot(sample.vx_m_s, sample.vy_m_s)
