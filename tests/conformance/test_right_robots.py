"""The kit fails no robot for what its promises allow, however unlike the reference adapter it is."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any
from unittest import mock

import pytest

from soter.adapters.pybullet.backend import KinematicBackend, KinematicRobot
from soter.conformance import Overall, Verdict, judge
from soter.conformance.clause import CLAUSES
from soter.conformance.find import InProcessHarness
from soter.sdk import Capabilities, Fleet, RobotSpec, RobotState
from tests.broken.in_process import Broken
from tests.broken.parts import memory, with_control
from tests.conformance.simulated import SimulatedHarness


class Noisy(Broken):
    """Its samples are off, by as much as it promises; anew with each sample, or always to the same side.

    Where they drift they are off by little: it drives by what is true, which no robot of this kind knows.
    """

    caught_by = ""
    drifts = False

    def _sample(self) -> RobotState:
        state, last = self._honest(), memory(self, "last", lambda: [None, None])
        if last[0] is not state:
            last[:] = state, self._blurred(state)
        return last[1]  # type: ignore[no-any-return]

    def _blurred(self, state: RobotState) -> RobotState:
        chance = random.Random(self.id) if self.drifts else memory(self, "chance", lambda: random.Random(self.id))
        promised, (here, there, turned) = self.declared, (chance.uniform(-math.pi, math.pi) for _ in range(3))
        off_m = promised.position_noise_m * (1.0 if self.drifts else chance.random())
        off_m_s = (promised.speed_noise_m_s or 0.0) * (1.0 if self.drifts else chance.random())
        heading_rad = state.heading_rad + (promised.heading_noise_rad or 0.0) * turned / math.pi
        return state._replace(
            x_m=state.x_m + off_m * math.cos(here), y_m=state.y_m + off_m * math.sin(here),
            vx_m_s=state.vx_m_s + off_m_s * math.cos(there), vy_m_s=state.vy_m_s + off_m_s * math.sin(there),
            heading_rad=math.remainder(heading_rad, math.tau),
        )  # fmt: skip


def noisy(drifts: bool, position_m: float, speed_m_s: float, heading_rad: float, **more: float) -> type[Noisy]:
    noise = {"position_noise_m": position_m, "speed_noise_m_s": speed_m_s, "heading_noise_rad": heading_rad}
    promised = replace(Noisy.declared, **{**noise, **more})  # type: ignore[arg-type] # no flag is among them
    parts: dict[str, Any] = {"declared": promised, "drifts": drifts}
    return type("Noisy", (Noisy,), parts)


CAUTIOUS = {"tube_m": 0.1, "overshoot_m": 0.08, "latency_s": 0.2, "brake_m_s2": 0.7, "body_radius_m": 0.12}
"""Promises that say less than the robot keeps."""


@pytest.mark.parametrize(
    "kind",
    [noisy(False, 0.03, 0.02, 0.03), noisy(True, 0.005, 0.02, 0.01, **CAUTIOUS)],
    ids=["noisy", "drifts and is cautious"],
)
@pytest.mark.long
def test_a_robot_that_keeps_what_it_promises_conforms(kind: type[Broken]) -> None:
    record = judge(SimulatedHarness(kind))
    assert [each.reason for each in record.outcomes if each.verdict is Verdict.FAIL] == []
    assert record.overall is Overall.CONFORMS


def test_a_slow_goal_of_a_robot_whose_places_are_rough_is_waited_for() -> None:
    record = judge(SimulatedHarness(noisy(True, 0.07, 0.02, 0.03)), [CLAUSES["goto.speed_cap"]])
    assert [each.verdict for each in record.outcomes] == [Verdict.PASS], record.outcomes


def sways(by_m_s: float, promised_m_s: float) -> type[Broken]:
    """Holds its place to and fro, as a copter does by an estimate that is off."""

    def edit(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
        goal = robot._mux.command
        if speed or rate or (goal is not None and math.dist(state[1:3], goal.target[:2]) > 0.05):
            return speed, rate
        return math.copysign(by_m_s, math.sin(math.tau * state[0])), rate

    promised = replace(Broken.declared, speed_noise_m_s=promised_m_s)
    parts: dict[str, Any] = {"declared": promised, "caught_by": "", "_connect": with_control(edit)}
    return type("Sways", (Broken,), parts)


@pytest.mark.parametrize(
    ("by_m_s", "promised_m_s", "verdict"),
    [(0.02, 0.03, Verdict.PASS), (0.02, 0.0, Verdict.FAIL), (0.1, 0.2, Verdict.FAIL)],
    ids=["promised", "not promised", "more than any noise excuses"],
)
def test_a_robot_at_rest_moves_by_the_truth_as_its_velocity_is_promised_to_be_off(
    by_m_s: float, promised_m_s: float, verdict: Verdict
) -> None:
    record = judge(SimulatedHarness(sways(by_m_s, promised_m_s)), [CLAUSES["truth.goto.holds"]])
    assert [each.verdict for each in record.outcomes] == [verdict], record.outcomes


class Swings(Broken):
    """Looks along each leg at once, and swings to and fro beside it for a while, as a copter out of a corner."""

    caught_by = ""
    off_rad = 0.0

    def _sample(self) -> RobotState:
        state = self._honest()
        x_m, y_m, heading_rad = self.beside(state.x_m, state.y_m, state.heading_rad)
        return state._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad)

    def beside(self, x_m: float, y_m: float, heading_rad: float) -> tuple[float, float, float]:
        """Return where it is, in place of where it would be without its swings."""
        now_s = self.clock.now()
        leg = memory(self, "leg", lambda: [heading_rad, now_s])
        if abs(math.remainder(heading_rad - leg[0], math.tau)) > 0.01:
            leg[:] = heading_rad, now_s
        on_s = now_s - leg[1]
        off_m = 0.1 * math.sin(on_s) * math.exp(-on_s / 2.0)
        looks_rad = math.remainder(heading_rad + self.off_rad, math.tau)
        return x_m - off_m * math.sin(heading_rad), y_m + off_m * math.cos(heading_rad), looks_rad


class SwingingHarness(SimulatedHarness):
    """Opens robots that swing, and a truth that says so."""

    room_m = 8.0

    def open(self, robots: int) -> Fleet:
        fleet = super().open(robots)
        honest, there = fleet.truth, {each.id: each for each in fleet.robots}
        told = mock.Mock(wraps=honest)
        told.pose = lambda robot_id: there[robot_id].beside(*honest.pose(robot_id))  # type: ignore[attr-defined, union-attr]
        fleet.truth = told
        return fleet


@pytest.mark.parametrize(("off_rad", "verdict"), [(0.0, Verdict.PASS), (0.3, Verdict.FAIL)], ids=["ahead", "askew"])
def test_a_heading_is_judged_where_the_course_is_that_of_the_leg(off_rad: float, verdict: Verdict) -> None:
    kind = type("Swings", (Swings,), {"off_rad": off_rad})
    clauses = [CLAUSES["state.heading"], CLAUSES["truth.state.heading"]]
    assert [each.verdict for each in judge(SwingingHarness(kind), clauses).outcomes] == [verdict, verdict]


class Unlike(InProcessHarness):
    """Robots that move unlike the reference robots, all of them; their batteries last as much longer."""

    promised: Capabilities

    def _opened(self, specs: Sequence[RobotSpec], places: int | None = None) -> Fleet:
        lasts = [replace(each, drive_s=10.0 * each.drive_s, idle_s=10.0 * each.idle_s) for each in specs]
        return super()._opened([replace(each, promised=each.promised or self.promised) for each in lasts], places)


@pytest.mark.parametrize(
    "promised",
    [
        {"v_max_m_s": 0.05, "yaw_rate_max_rad_s": 4.8},
        {"v_max_m_s": 0.2, "brake_m_s2": 0.13, "accel_m_s2": 0.17, "lease_s": 0.3},
        {"brake_m_s2": 4.0, "accel_m_s2": 3.0, "yaw_rate_max_rad_s": 0.2, "body_radius_m": 0.3},
    ],
    ids=["slow", "weak", "strong and slow to turn"],
)
@pytest.mark.long
def test_a_robot_of_any_speed_and_strength_conforms(promised: Mapping[str, Any]) -> None:
    harness = Unlike("unlike", KinematicBackend)
    harness.promised = replace(KinematicRobot.declared, **promised)
    record = judge(harness)
    assert [each.reason for each in record.outcomes if each.verdict is Verdict.FAIL] == []
    assert record.overall is Overall.CONFORMS


@pytest.mark.parametrize(
    ("promised", "said"),
    [
        ({"v_max_m_s": 2.0}, "room_m = "),
        ({"v_max_m_s": 0.02}, "is empty"),
    ],
    ids=["fast", "slow on a short charge"],
)
def test_a_failure_says_what_the_harness_has_too_little_of(promised: Mapping[str, Any], said: str) -> None:
    class Short(Unlike):
        def _opened(self, specs: Sequence[RobotSpec], places: int | None = None) -> Fleet:
            return InProcessHarness._opened(
                self, [replace(each, promised=each.promised or self.promised) for each in specs], places
            )

    harness = Short("short", KinematicBackend)
    harness.promised = replace(KinematicRobot.declared, **promised)
    record = judge(harness, [CLAUSES["bounds.overshoot"], CLAUSES["goto.wakes"], CLAUSES["bounds.tube"]])
    assert any(said in each.reason for each in record.outcomes if each.verdict is Verdict.FAIL)
