"""The margins of the shipped rules, and of simulated robots, never fall by more than the models of a mission allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.adapters.pybullet import KinematicBackend, PyBulletBackend
from soter.config.tables import MotionModel
from soter.errors import IllFormedModule
from soter.rta import (
    DirectedReach,
    PairBound,
    Region,
    Sample,
    Situation,
    SpeedAccelerationBound,
    SpeedBound,
    UnicycleBound,
)
from soter.sdk import RobotSpec
from soter.stack.collision import Separation
from soter.stack.reach import MotionLimits, reach_between, reach_into
from soter.stack.static_rules import Clearance, Fence
from soter.stack.terrain import Terrain
from soter_sim import BODY_RADIUS_M, LIMITS, Control, World
from tests.rta.doubles import At
from tests.sim.worlds import CASE

STEP_S = 0.05
V_MAX, YAW_MAX = LIMITS.v_max_m_s, LIMITS.yaw_rate_max_rad_s
MODELS: list[MotionModel] = ["speed", "speed-acceleration", "unicycle"]
PROMISED = KinematicBackend.robot_class.declared
TERRAIN = Terrain(CASE, BODY_RADIUS_M)
FENCE, CLEARANCE, SEPARATION = Fence(0.0, 5.0, 0.0, 5.0), Clearance(TERRAIN), Separation(0.3, V_MAX)

Input = tuple[float, float]

shares = st.floats(-1.0, 1.0)
extremes = st.sampled_from([-1.0, 0.0, 1.0])
inputs = st.one_of(
    st.lists(st.tuples(shares, shares), min_size=20, max_size=20),
    st.lists(st.tuples(extremes, extremes), min_size=20, max_size=20),
    st.tuples(st.tuples(extremes, extremes), st.tuples(extremes, extremes), st.integers(0, 20)).map(
        lambda parts: [parts[0]] * parts[2] + [parts[1]] * (20 - parts[2])
    ),
)
places = st.tuples(st.floats(0.02, 4.98), st.floats(0.02, 4.98)).filter(lambda at: TERRAIN.clearance_m(*at) > 0.0)
states = st.tuples(places, st.floats(-math.pi, math.pi), shares)
State = tuple[tuple[float, float], float, float]


def told(commands: Sequence[Input], until: int) -> Control:
    """A control that commands shares of top speed and turn rate, and then to stop while it goes on turning."""

    def control(now_s: float, *_: float) -> tuple[float, float]:
        step = min(round(now_s / STEP_S), len(commands) - 1)
        v, w = commands[step]
        return (v * V_MAX if round(now_s / STEP_S) < until else 0.0), w * YAW_MAX

    return control


def run(starts: Sequence[State], commands: Sequence[Sequence[Input]], until: int) -> list[list[Sample]]:
    """Drive robots for `until` steps, then let them brake to rest; return their samples at every step."""
    specs = [RobotSpec(number, *start[0], start[1]) for number, start in enumerate(starts, start=1)]
    with World(CASE, specs, "kinematic") as world:
        for number, (start, driven) in enumerate(zip(starts, commands, strict=True)):
            world.bodies.v[number] = start[2] * V_MAX
            world.set_control(number + 1, told(driven, until))
        seen = [samples(world)]
        while len(seen) <= until or any(world.bodies.v):
            world.advance(len(seen) * STEP_S)
            seen.append(samples(world))
    return seen


def samples(world: World) -> list[Sample]:
    bodies = world.bodies
    return [
        At(
            bodies.x[i], bodies.y[i], world.now_s, i + 1, bodies.heading[i],
            bodies.v[i] * math.cos(bodies.heading[i]), bodies.v[i] * math.sin(bodies.heading[i]),
        )
        for i in range(len(bodies.x))
    ]  # fmt: skip


def view(seen: Sequence[Sample]) -> Situation:
    situation = Situation(1, seen[0], seen[0].stamp_s)
    situation.peers = seen[1:]
    return situation


def check(region: Region, reach: float, seen: Sequence[Sequence[Sample]]) -> None:
    margins = [region.margin(view(each)) for each in seen]
    assert margins[0] - min(margins) <= reach + 1e-9


@pytest.mark.parametrize("model", MODELS)
@given(start=states, commands=inputs, until=st.integers(1, 20))
def test_no_input_takes_more_off_fence_and_boxes_than_the_model_allows(
    model: MotionModel, start: State, commands: list[Input], until: int
) -> None:
    motion = MotionLimits.of(PROMISED).motion("geofence", model)
    seen = run([start], [commands], until)
    for region in (FENCE, CLEARANCE):
        reach = reach_into(region, motion)
        most = reach.reach(view(seen[0]), until * STEP_S)
        assert most <= reach.bound(until * STEP_S) + 1e-12
        check(region, most, seen)
    for (before,), (after,) in pairwise(seen):
        assert motion.admits(before, after, 0.0)


@pytest.mark.parametrize("model", MODELS)
@given(
    start=states, angle=st.floats(-math.pi, math.pi), away_m=st.floats(0.25, 0.8), heading=st.floats(-math.pi, math.pi),
    share=shares, commands=inputs, others=inputs, until=st.integers(1, 12),
)  # fmt: skip
def test_no_inputs_take_more_off_the_distance_of_two_robots_than_the_model_allows(
    model: MotionModel, start: State, angle: float, away_m: float, heading: float, share: float,
    commands: list[Input], others: list[Input], until: int,
) -> None:  # fmt: skip
    (x, y), _, _ = start
    peer = (x + away_m * math.cos(angle), y + away_m * math.sin(angle))
    assume(TERRAIN.clearance_m(*peer) > 0.0)
    motion = MotionLimits.of(PROMISED).motion("collision", model)
    reach = reach_between(SEPARATION, motion, motion)
    seen = run([start, (peer, heading, share)], [commands, others], until)
    most = reach.reach(view(seen[0]), until * STEP_S)
    assert most <= reach.bound(until * STEP_S) + 1e-12
    check(SEPARATION, most, seen)


@given(start=states, commands=inputs, others=inputs, lag=st.integers(1, 8), away_m=st.floats(0.3, 0.8))
def test_a_peer_that_was_seen_some_time_ago_may_have_moved_since(
    start: State, commands: list[Input], others: list[Input], lag: int, away_m: float
) -> None:
    (x, y), _, _ = start
    assume(TERRAIN.clearance_m(x, y + away_m) > 0.0)
    motion = MotionLimits.of(PROMISED).motion("collision", "unicycle")
    reach = reach_between(SEPARATION, motion, motion)
    seen = run([start, ((x, y + away_m), 0.0, 1.0)], [commands, others], lag + 4)
    situation = Situation(1, seen[lag][0], lag * STEP_S)
    situation.peers = [seen[0][1]]
    margin, most = SEPARATION.margin(situation), reach.reach(situation, 4 * STEP_S)
    assert most <= reach.bound(4 * STEP_S) + 1e-12
    assert min(SEPARATION.margin(view(each)) for each in seen[lag:]) >= margin - most - 1e-9


@given(start=states, other=states)
def test_threats_are_the_parts_of_the_margin(start: State, other: State) -> None:
    situation = view([At(*start[0]), At(*other[0], robot_id=2)])
    for region in (FENCE, CLEARANCE, SEPARATION):
        threats = region.threats(situation)
        assert min(threat.margin for threat in threats) == pytest.approx(region.margin(situation), abs=1e-12)
        for threat in threats:
            assert math.hypot(threat.ux, threat.uy) == pytest.approx(1.0)


@given(at=st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)), by=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)))
def test_no_part_of_a_clearance_falls_faster_than_along_its_threat(at: tuple[float, float], by: Input) -> None:
    for (here, ux, uy), (there, _, _) in zip(
        TERRAIN.walls(*at), TERRAIN.walls(at[0] + by[0], at[1] + by[1]), strict=True
    ):
        assert there >= here - (ux * by[0] + uy * by[1]) - 1e-9


def test_a_unicycle_that_drives_along_a_wall_may_be_nearer_to_it() -> None:
    unicycle = reach_into(FENCE, MotionLimits.of(PROMISED).motion("geofence", "unicycle"))
    along = view([At(0.05, 2.5, heading_rad=math.pi / 2, vy_m_s=V_MAX)])
    towards = view([At(0.05, 2.5, heading_rad=math.pi, vx_m_s=-V_MAX)])
    assert unicycle.reach(along, 0.15) < 0.05 < unicycle.reach(towards, 0.15)


def test_a_margin_that_is_no_number_makes_a_reach_that_is_none() -> None:
    unicycle = reach_into(FENCE, MotionLimits.of(PROMISED).motion("geofence", "unicycle"))
    assert math.isnan(unicycle.reach(view([At(math.nan, 2.5)]), 0.15))


def test_without_peers_no_distance_falls() -> None:
    motion = MotionLimits.of(PROMISED).motion("collision", "unicycle")
    assert reach_between(SEPARATION, motion, motion).reach(view([At(1.0, 1.0)]), 1.0) == 0.0


def test_robots_at_one_place_are_in_danger_wherever_they_face() -> None:
    motion = MotionLimits.of(PROMISED).motion("collision", "unicycle")
    situation = view([At(1.0, 1.0), At(1.0, 1.0, robot_id=2)])
    reach = reach_between(SEPARATION, motion, motion).reach(situation, 1.0)
    assert SEPARATION.margin(situation) - reach < 0.0


# --- what a mission chooses --------------------------------------------------------------------------------


def test_each_model_is_what_its_name_says() -> None:
    limits = MotionLimits.of(PROMISED)
    speed, accelerating, unicycle = (limits.motion("geofence", model) for model in MODELS)
    assert reach_into(FENCE, speed) is speed
    assert reach_into(FENCE, accelerating) is accelerating
    assert isinstance(reach_into(FENCE, unicycle), DirectedReach)
    assert isinstance(reach_between(SEPARATION, speed, speed), PairBound)
    assert isinstance(speed, SpeedBound)
    assert isinstance(accelerating, SpeedAccelerationBound)
    for motion in (accelerating, unicycle):
        pair = reach_between(SEPARATION, motion, motion)
        assert pair.of_pairs
        assert pair.of_own() is motion
        assert pair.bound(0.7) == pytest.approx(2.0 * speed.bound(0.7))


def test_the_worst_of_several_robots_is_taken() -> None:
    slow = replace(PROMISED, v_max_m_s=0.1, brake_m_s2=0.5, accel_m_s2=3.0, reverses=False)
    worst = MotionLimits.of(PROMISED, slow)
    assert worst.v_max_m_s == worst.reverse_m_s == V_MAX
    assert (worst.brake_m_s2, worst.accel_m_s2) == (0.5, 3.0)
    assert MotionLimits.of(slow).reverse_m_s == 0.0


MISSING: list[tuple[MotionModel, str]] = [
    ("speed-acceleration", "accel_m_s2"), ("speed-acceleration", "speed_noise_m_s"), ("unicycle", "heading_noise_rad"),
]  # fmt: skip


@pytest.mark.parametrize(("model", "promise"), MISSING)
def test_a_model_that_needs_what_nobody_promised_is_refused(model: MotionModel, promise: str) -> None:
    unpromised: dict[str, Any] = {promise: None}
    lacking = replace(PROMISED, **unpromised)
    with pytest.raises(IllFormedModule, match=f"'{model}' needs {promise}.*model = \"speed\" would do"):
        MotionLimits.of(PROMISED, lacking).motion("collision", model)
    assert isinstance(MotionLimits.of(lacking).motion("collision", "speed"), SpeedBound)


def test_robots_of_physics_promise_what_a_unicycle_needs() -> None:
    motion = MotionLimits.of(PyBulletBackend.robot_class.declared).motion("obstacle", "unicycle")
    assert isinstance(motion, UnicycleBound)
    assert motion.speed_noise_m_s > 0.0
