"""Rules of a user's own, judged by the true poses of robots."""

from __future__ import annotations

import math

import pytest

from soter.check.user_rules import UserRules
from soter.rta import DecisionModule, Region, RTAModule, Situation, Timing
from soter.sdk import TruthReport
from soter.stack.own_rules import OwnRule
from tests.rta.doubles import TICK_S, At, FakeNode, Meddles, Unspeakable, module
from tests.stack.ground import seen


class Slow(Region):
    """No faster than 0.1 m/s."""

    def margin(self, situation: Situation) -> float:
        return 0.1 - math.hypot(situation.own.vx_m_s, situation.own.vy_m_s)

    def edge_margin(self, safer: Region) -> float:
        return 0.0


class Moving:
    """A truth that is where the test puts it."""

    def __init__(self) -> None:
        self.x_m = 0.0

    def report(self) -> TruthReport:
        return TruthReport(())

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        return self.x_m * robot_id, 0.0, 0.0


class Robot:
    """As much of a supervisor as the judge asks."""

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self.situation = seen(At(99.0, vx_m_s=99.0, robot_id=robot_id))


def judged(speeds: list[float], declared: RTAModule) -> UserRules:
    truth = Moving()
    rules = UserRules(truth, {1: (declared,), 2: (declared,)})
    for tick, speed in enumerate([0.0, *speeds]):
        truth.x_m += speed * 0.05
        rules.look(tick * 0.05, [Robot(1), Robot(2)])  # type: ignore[list-item]
    return rules


def test_speeds_come_from_true_poses_not_from_what_robots_report() -> None:
    rules = judged([0.04, 0.06, 0.06, 0.04, 0.12], module("slow", phi_safe=Slow()))
    assert rules.counts() == {"slow": 3}, "robot 2 is twice as fast: once, and once more; robot 1 once"
    assert rules.min_margin["slow"] == pytest.approx(0.1 - 0.24)
    first = min(rules.violations(), key=lambda each: each.start_s)
    assert (first.robots, first.end_s is not None) == ((2,), True)
    assert first.start_s == pytest.approx(0.1)
    assert [each.end_s for each in rules.violations()].count(None) == 2, "what goes on has no end"


def test_a_rule_without_a_region_cannot_be_judged() -> None:
    predicates = RTAModule(
        "slow", FakeNode("ac"), FakeNode("sc"), 0.1, None, lambda s: True, ttf_2delta=lambda s: False
    )  # fmt: skip
    rules = judged([1.0], predicates)
    assert rules.names == ()
    assert rules.counts() == {}


@pytest.mark.parametrize("answer", [None, "far", RuntimeError("the rule failed"), SystemExit(0), Unspeakable()])
def test_a_rule_that_cannot_be_judged_counts_as_broken_and_the_run_goes_on(
    answer: object, caplog: pytest.LogCaptureFixture
) -> None:
    class Odd(Slow):
        def margin(self, situation: Situation) -> float:
            if isinstance(answer, BaseException):
                raise answer
            return answer  # type: ignore[return-value]

    rules = judged([0.0, 0.0, 0.0], module("odd", phi_safe=Odd()))
    assert rules.counts() == {"odd": 2}, "once for each robot"
    assert [record.getMessage() for record in caplog.records] == ["the rule of 'odd' cannot be judged"]


def test_what_a_rule_does_to_what_it_is_given_nobody_else_sees() -> None:
    own, peer = At(3.0), At(4.0, robot_id=2)
    situation = Situation(1, own, 7.0)
    situation.peers = [peer]
    decision = DecisionModule(module(phi_safe=Meddles(), phi_safer=Meddles()), Timing(), TICK_S, foreign=True)
    decision.decide(situation)
    decision.observe(situation)
    assert OwnRule(Meddles(), of_pairs=True).allows(situation, 3.1, 0.0, 0.02, 0.35, 0.0)
    assert (situation.own, situation.peers, situation.now_s) == (own, [peer], 7.0)
