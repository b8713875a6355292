"""Robots of which only symbols are known, and the code that judges them, on Z3's reals."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import pytest
import z3

from soter.rta import PairBound, Region, RTAModule, Situation, SpeedBound, Timing
from soter.rta.decision import DecisionModule
from soter.stack.collision import Separation
from soter.stack.recovery import RecoveryPlanner, RecoveryRules, extent_m
from tests.proofs.symbolic import Fact, SymbolicMath, greatest, least, positive, size
from tests.rta.doubles import At, FakeNode

MODULES: Final = ("collision", "recovery", "return_path", "site_terrain", "static_rules", "terrain")
"""Those of `soter.stack` whose arithmetic is run."""

NODE: Final = FakeNode("node")


class Obligation(NamedTuple):
    """One inequality of a lemma.

    Attributes:
        name: which.
        claim: what has to hold.
        given: what it is to follow from.
    """

    name: str
    claim: Fact
    given: list[Fact]


def on_reals(patch: pytest.MonkeyPatch) -> SymbolicMath:
    """Have the code calculate with Z3's reals until the test ends."""
    symbolic = SymbolicMath()
    patch.setattr(z3.ArithRef, "__truediv__", lambda value, by: symbolic.quotient(value, by))
    for name in (*(f"stack.{each}" for each in MODULES), "rta.module"):
        patch.setattr(sys.modules[f"soter.{name}"], "math", symbolic)
        patch.setattr(sys.modules[f"soter.{name}"], "max", greatest, raising=False)
        patch.setattr(sys.modules[f"soter.{name}"], "min", least, raising=False)
    for name in ("decision", "module"):
        code = sys.modules[f"soter.rta.{name}"]
        patch.setattr(code, "plain", lambda value: value)
        patch.setattr(code, "round", lambda _: 1, raising=False)
    for name in ("bounds", "motion"):
        code = sys.modules[f"soter.rta.models.{name}"]
        for built_in, ours in {"max": greatest, "min": least, "abs": size, "hypot": symbolic.hypot}.items():
            patch.setattr(code, built_in, ours, raising=False)
        for check in ("positive", "not_negative"):
            patch.setattr(code, check, lambda _, value: value, raising=False)
    patch.setattr(sys.modules["soter.rta.module"], "_ROUNDING", 0)
    patch.setattr(sys.modules["soter.stack.collision"], "_ROUNDING", 0)
    # It only looks for a value that a refusal can suggest.
    patch.setattr(RTAModule, "_largest_delta_s", lambda *_: None)
    return symbolic


@dataclass(frozen=True)
class Line(Region):
    """Situations whose margin is `seen`; the edge of one with another `least_m` is so much farther inside."""

    seen: Any
    least_m: Any = 0

    def margin(self, situation: Situation) -> Any:
        return self.seen - self.least_m

    def edge_margin(self, safer: Region) -> Any:
        assert isinstance(safer, Line)
        return safer.least_m - self.least_m


@dataclass(frozen=True)
class Gap(Separation):
    """A separation that is seen to be left by so much."""

    seen: Any = 0

    def margin(self, situation: Situation) -> Any:
        return self.seen


@dataclass
class Robot:
    """What a robot promises, as symbols, and what is known of them."""

    name: str = ""
    facts: list[Fact] = field(default_factory=list)

    def __post_init__(self) -> None:
        names = ("speed", "brake", "latency", "sample_age", "jitter", "noise", "lease", "tube")
        reals, facts = positive(" ".join(name + self.name for name in names))
        self.v, self.b, self.L, self.A, self.J, self.noise, self.lease, self.tube = reals
        self.delta, self.tau, self.a = z3.Reals(f"delta{self.name} tick age{self.name}")
        # Delta is a multiple of the base tick (P1a).
        self.facts += [*facts, self.tau > 0, self.delta >= self.tau, self.a >= 0, self.a <= self.A]

    @property
    def stop_m(self) -> Any:
        """How far it gets while it brakes from top speed."""
        return self.v * self.v / (2 * self.b)

    @property
    def speed_bound(self) -> SpeedBound:
        """Its motion."""
        return SpeedBound(self.v, self.b)

    @property
    def timing(self) -> Timing:
        """What it adds to every horizon."""
        return Timing(self.L, self.A, self.J, self.noise, self.lease, self.tau)

    @property
    def capabilities(self) -> Any:
        """What its recovery planner reads."""
        return SimpleNamespace(
            v_max_m_s=self.v, brake_m_s2=self.b, latency_s=self.L, sample_age_s=self.A, tube_m=self.tube,
            position_noise_m=self.noise, moving_m_s=0, reverses=True, yaw_rate_max_rad_s=1,
        )  # fmt: skip

    def recovery(self, separation_m: Any = 0, peer: Robot | None = None, terrain: Any = None) -> RecoveryPlanner:
        """Return its planner."""
        # A supervisor ticks all of its robots alike.
        peers = (0, 0, 0) if peer is None else (peer.noise, peer.v, extent_m(peer.capabilities, self.tau))
        return RecoveryPlanner(terrain, self.capabilities, RecoveryRules(separation_m=separation_m), self.tau, *peers)

    def module(self, phi_safe: Region, phi_safer: Region, peer: Robot | None = None, keep: Any = 0) -> RTAModule:
        """Return a module of its."""
        model = self.speed_bound if peer is None else PairBound(self.speed_bound, peer.speed_bound)
        return RTAModule("m", NODE, NODE, self.delta, phi_safe, phi_safer, model, keep=keep)

    def decision(self, module: RTAModule) -> DecisionModule:
        """Return the decision module of one."""
        return DecisionModule(module, self.timing, self.tau)

    def situation(self, *peers: At) -> Situation:
        """Return what it sees with a sample as old as `a`, at time 0."""
        look = Situation(1, At(0, 0, -self.a), 0)
        look.peers = peers
        return look
