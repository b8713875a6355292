"""The declaration of a safety module, and the conditions under which it keeps its rule."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from soter.errors import IllFormedModule, account_of, raised_at
from soter.rta.models import ReachModel
from soter.rta.situation import Sample, Situation
from soter.rta.topics import Node

_ROUNDING = 1e-9


def plain(value: Any) -> float:
    """Return the answer of a rule or a model as a plain Python float, which cannot fail later on.

    Raises:
        TypeError: it is no number.
        ValueError: it cannot be converted to a float.
        OverflowError: it is too large for a float.
    """
    if type(value) is float:
        return value
    if isinstance(value, str | bytes | bytearray):
        raise TypeError(f"{value!r} is no number")
    return float(value)


@dataclass(frozen=True, slots=True)
class Timing:
    """What the robot adds to every horizon.

    Attributes:
        latency_s: from a decision to the vehicle acting on it, at most (L).
        sample_age_s: age of a sample when it is judged, at most (A_max).
        jitter_s: how late a tick may come, at most (J).
        noise_m: error of a reported position, at most.
        lease_s: how long the robot moves on when the supervisor falls silent.
        tick_s: how often the lease is renewed.
        deltas: how many Delta a module looks ahead, for studies of that number; None for what proofs need.
        speed_noise_m_s: error of a reported velocity, at most; None if none is promised.
    """

    latency_s: float = 0.0
    sample_age_s: float = 0.0
    jitter_s: float = 0.0
    noise_m: float = 0.0
    lease_s: float = 0.0
    tick_s: float = 0.0
    deltas: float | None = None
    speed_noise_m_s: float | None = None

    def silent_s(self, delta_s: float) -> float:
        """Return how long a robot moves on at most after a look of a module, if its supervisor dies before the next.

        The lease is renewed once more at the last tick before the next look is due.
        """
        return max(delta_s - self.tick_s, 0.0) + self.lease_s

    def ahead_s(self, delta_s: float) -> float:
        """Return how far ahead a module looks, before latency, age and jitter: 2 Delta, or more for a long lease.

        The robot must stay inside phi_safe even if its supervisor dies.
        """
        return max(2.0 * delta_s, self.silent_s(delta_s)) if self.deltas is None else self.deltas * delta_s

    def look_s(self, delta_s: float) -> float:
        """Return how long controllers may drive on after a look at a fresh sample: S + L + J."""
        return self.ahead_s(delta_s) + self.latency_s + self.jitter_s

    def horizon_s(self, delta_s: float) -> float:
        """Return the horizon H: `look_s` plus the largest age of a sample."""
        return self.ahead_s(delta_s) + self.latency_s + self.sample_age_s + self.jitter_s


class Region(ABC):
    """A set of situations with a signed distance to its edge: a margin, at least 0 inside."""

    unit: str = "m"
    """Unit of the margins."""

    @abstractmethod
    def margin(self, situation: Situation) -> float:
        """Return the margin. A value that is not a number counts as outside."""

    @abstractmethod
    def edge_margin(self, safer: Region) -> float:
        """Return the least margin in this region of any situation that lies in the region `safer`."""

    def leaves_room(self, situation: Situation, margin: float, keep: float, fall: float) -> bool:
        """Return whether a safe controller can still move after the margin has fallen.

        Args:
            situation: see `margin`.
            margin: what `margin` returns for it.
            keep: what the safe controller needs (`RTAModule.keep`).
            fall: by how much the margin may fall, or be wrong, in all.
        """
        return margin - keep >= fall

    def noise(self, noise_m: float) -> float:
        """Return by how much the margin may be wrong when a position is wrong by `noise_m`."""
        return noise_m


def margin_of(region: Region, situation: Situation) -> float:
    """Return a region's margin of a situation; NaN, which counts as outside, if foreign code fails."""
    return _answer(region, situation.copy())


def no_answer(region: Region, situation: Situation) -> str:
    """Return, in words, why a region's margin of a situation is no number; empty if it is one."""
    try:
        margin = plain(region.margin(situation.copy()))
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # noqa: BLE001 - foreign code
        return account_of(failure) + raised_at(failure)
    return "it is not a number" if math.isnan(margin) else ""


def looks_at_peers(region: Region, situation: Situation) -> bool:
    """Return whether a region's margin reads the peers of the situation, which must have some."""
    watched = situation.copy()
    watched.peers = peers = _Watched(situation.peers)
    _answer(region, watched)
    return peers.looked_at


def _answer(region: Region, situation: Situation) -> float:
    try:
        return plain(region.margin(situation))
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - foreign code
        return math.nan


class _Watched(Sequence[Sample]):
    """A sequence of samples that notes whether it was read."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self._samples = samples
        self.looked_at = False

    def __getitem__(self, index: Any) -> Any:
        self.looked_at = True
        return self._samples[index]

    def __len__(self) -> int:
        self.looked_at = True
        return len(self._samples)


@dataclass(frozen=True, slots=True)
class RTAModule:
    """A safety module: its controllers, its period, its rule and its reach model.

    It is a template: a supervisor binds it to one robot, or to one robot and its peers, and makes the decision module,
    its monitor and its metrics from it.

    Attributes:
        name: its name in causes and reports.
        ac: the advanced controller's node.
        sc: the safe controller's node.
        delta_s: period of the decision module (Delta).
        phi_safe: the rule, with its margin; None when the rule is given by predicates.
        phi_safer: where control may go back to the AC: a region, or a predicate.
        model: R(T) of the margin; None when the rule is given by predicates.
        ttf_2delta: predicate "may fail within two Delta", instead of phi_safe and model. It is then the author's
            assumption, which falsification tests and no proof backs.
        dwell_s: how long phi_safer must hold before control goes back.
        keep: margin that the safe controller needs to be able to move at all; control is taken, and given back, while
            at least this much is left beyond what the AC can use up.
        lets_go_s: contract with the modules of lower priority: while one of them needs to drive, this module's safe
            controller has the robot for no longer. Infinite if the safe controller itself does what they need; for
            a module of the user's that leaves it out, 30 s.
        peers_within_m: largest distance at which a peer matters to the rule; nearer peers are always in the situation.
            By default all peers, which costs the square of the number of robots; 0 for a rule without peers.
        premise: checks what else has to hold on a robot; raises `IllFormedModule` if it does not.
        most_edge: the largest margin that the edge of any phi_safer can have; None if there is no largest.
        instead: the remedy to name in the error when no phi_safer is large enough.
    """

    name: str
    ac: Node
    sc: Node
    delta_s: float
    phi_safe: Region | None
    phi_safer: Region | Callable[[Situation], bool]
    model: ReachModel | None = None
    ttf_2delta: Callable[[Situation], bool] | None = None
    dwell_s: float = 0.3
    keep: float = 0.0
    lets_go_s: float = math.inf
    peers_within_m: float = math.inf
    premise: Callable[[RTAModule, Timing], None] | None = None
    most_edge: float | None = None
    instead: str = ""

    @property
    def of_pairs(self) -> bool:
        """Whether the rule is between this robot and others."""
        return self.model is not None and self.model.of_pairs

    def horizon_s(self, timing: Timing) -> float:
        """Return H of this module on a robot; see `Timing.horizon_s`."""
        return timing.horizon_s(self.delta_s)

    def edge_margin(self) -> float:
        """Return the margin at the edge of phi_safer, or NaN for a rule given by predicates."""
        if self.phi_safe is None or not isinstance(self.phi_safer, Region):
            return math.nan
        return plain(self.phi_safe.edge_margin(self.phi_safer))

    def reach(self, timing: Timing) -> float:
        """Return R(H), the most that the margin can fall within the horizon, or NaN for a rule given by predicates."""
        return math.nan if self.model is None else plain(self.model.bound(self.horizon_s(timing)))

    def check(self, timing: Timing, base_tick_s: float) -> None:
        """Check P1, P3 and the module's own premise against the figures of a robot.

        Args:
            timing: the robot's latency, sample age, jitter and noise.
            base_tick_s: period of the supervisor, of which Delta must be a multiple.

        Raises:
            IllFormedModule: a condition does not hold; it names the condition, the numbers and a value that would do.
        """
        try:
            self._check_declaration()
            self._check_periods(base_tick_s)
            if self.phi_safe is not None and self.model is not None:
                self._check_reach(self.phi_safe, self.model, timing, base_tick_s)
                # Samples are tested against each model once.
                hash(self.model.of_own())
            if self.premise is not None:
                self.premise(self, timing)
        except IllFormedModule as failure:
            if failure.module == self.name:
                raise
            # A premise may say another name; what is told of a module is found by its own.
            raise failure.named(self.name) from failure
        except KeyboardInterrupt:
            raise
        except BaseException as failure:  # foreign code
            words = f"it fails when it is evaluated: {account_of(failure)}{raised_at(failure)}"
            raise IllFormedModule(self.name, "P3", words) from failure

    def _check_declaration(self) -> None:
        if not 0.0 < self.delta_s < math.inf:
            raise IllFormedModule(self.name, "P1a", f"delta_s is {self.delta_s}, allowed: above 0")
        if not 0.0 <= self.dwell_s < math.inf:
            raise IllFormedModule(self.name, "P1a", f"dwell_s is {self.dwell_s}, allowed: 0 or more")
        if not self.lets_go_s >= 0.0:
            raise IllFormedModule(self.name, "P2c", f"lets_go_s is {self.lets_go_s}, allowed: 0 or more")
        if not self.peers_within_m >= 0.0:
            raise IllFormedModule(self.name, "P1a", f"peers_within_m is {self.peers_within_m}, allowed: 0 or more")
        if self.phi_safe is not None and not isinstance(self.phi_safe.unit, str):
            raise IllFormedModule(self.name, "P3", f"the unit of phi_safe is {self.phi_safe.unit!r}, allowed: a text")
        by_margin = self.phi_safe is not None and self.model is not None
        by_predicate = self.ttf_2delta is not None
        if by_margin == by_predicate:
            raise IllFormedModule(
                self.name, "P3", "give either phi_safe with a model, or the predicate ttf_2delta, and not both"
            )

    def _check_periods(self, base_tick_s: float) -> None:
        for role, node in (("AC", self.ac), ("SC", self.sc)):
            if node.period_s > self.delta_s + _ROUNDING:
                fits = math.ceil(node.period_s / base_tick_s - 1e-6) * base_tick_s
                raise IllFormedModule(
                    self.name,
                    "P1a",
                    f"the {role} '{node.name}' has a period of {node.period_s:.12g} s, longer than Delta = "
                    f"{self.delta_s:.12g} s; a period of {self.delta_s:.12g} s or a Delta of {fits:.12g} s would do",
                )
        ticks = self.delta_s / base_tick_s
        if abs(ticks - round(ticks)) > 1e-6 or round(ticks) < 1:
            fits = max(1, round(ticks)) * base_tick_s
            raise IllFormedModule(
                self.name,
                "P1a",
                f"Delta = {self.delta_s:.12g} s is no multiple of the base tick of {base_tick_s:.12g} s; {fits:.12g} s "
                "would do",
            )
        if set(self.ac.publishes) != set(self.sc.publishes) or not self.ac.publishes:
            ac, sc = (sorted(map(str, node.publishes)) for node in (self.ac, self.sc))
            by_name = all(isinstance(topic, str) for node in (self.ac, self.sc) for topic in node.publishes)
            raise IllFormedModule(
                self.name,
                "P1b",
                f"the AC publishes {ac}, the SC {sc}; both must publish the same topics, at least one"
                f"{'' if by_name else ', and name them, such as (kit.waypoint.name,)'}",
            )

    def _check_reach(self, phi_safe: Region, model: ReachModel, timing: Timing, base_tick_s: float) -> None:
        if not isinstance(self.phi_safer, Region):
            return
        edge, noise = plain(phi_safe.edge_margin(self.phi_safer)), plain(phi_safe.noise(timing.noise_m))
        horizon_s = self.horizon_s(timing)
        reach = plain(model.bound(horizon_s))
        # Written so that NaN is refused.
        if edge - noise - self.keep - reach >= -_ROUNDING:
            return
        unit = phi_safe.unit
        # Only NaN is not.
        if not edge <= math.inf:
            raise IllFormedModule(
                self.name,
                "P3",
                f"edge_margin of {type(phi_safe).__name__} returns {edge} for phi_safer, a "
                f"{type(self.phi_safer).__name__}; it has to return the least margin of phi_safe in it, in {unit}",
            )
        needed = reach + noise + self.keep
        remedy, in_short, instead = "no phi_safer", "", ""
        if self.most_edge is not None and needed > self.most_edge + _ROUNDING:
            instead = f", since its edge has a margin of at most {self.most_edge:.3f} {unit}"
            instead += f"; {self.instead} would" if self.instead else ""
        elif needed < math.inf:
            # Rounded up, so that this very value passes.
            remedy = f"a phi_safer whose edge has a margin of {math.ceil(needed * 1000.0 - 1e-6) / 1000.0:.3f} {unit}"
            in_short = remedy
        wrong = f" and be wrong by {noise:.3f} {unit}" if noise > 0.0 else ""
        wrong += f" and {self.keep:.3f} {unit} is kept for the safe controller" if self.keep > 0.0 else ""
        by_lease = timing.silent_s(self.delta_s) > 2.0 * self.delta_s
        head = "the last look before the supervisor dies, the lease" if by_lease else "2 Delta"
        fits_s = self._largest_delta_s(model, edge - noise - self.keep, timing, base_tick_s)
        if fits_s is not None:
            in_short = f"Delta = {fits_s:g} s"
            remedy += f", but {in_short}," if remedy.startswith("no") else f", or {in_short},"
        raise IllFormedModule(
            self.name,
            "P3",
            f"within {head} + latency + age + jitter = {horizon_s:.3f} s the margin can fall by {reach:.3f} {unit}"
            f"{wrong}, but at the edge of phi_safer it is only {edge:.3f} {unit}; {remedy} would do{instead}",
            remedy=in_short,
        )

    def _largest_delta_s(self, model: ReachModel, most: float, timing: Timing, base_tick_s: float) -> float | None:
        least = max(1, math.ceil(max(self.ac.period_s, self.sc.period_s) / base_tick_s - 1e-6))
        for ticks in range(round(self.delta_s / base_tick_s) - 1, least - 1, -1):
            fits_s = ticks * base_tick_s
            if model.bound(replace(self, delta_s=fits_s).horizon_s(timing)) <= most + _ROUNDING:
                return fits_s
        return None
