"""Robots that are unlike: each has its own figures, a pair those of both, and nobody those of the first."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import admit, declare_all
from soter.config import load_mission
from soter.rta import PairBound, PairsBound, Situation, SpeedBound
from soter.specs import asked, read_options
from soter.stack.collision import Separation
from soter.stack.peers import Peers
from tests.project.source import ROOT
from tests.rta.doubles import TICK_S, At

TURTLE = KinematicBackend.robot_class.declared
MISSION = load_mission(ROOT / "examples" / "unlike-fleet.toml")
HALL = MISSION.read_workspace()
PROMISED = asked(KinematicBackend, read_options(KinematicBackend, MISSION, HALL), MISSION, HALL)
BOUNDS = st.builds(SpeedBound, st.floats(0.05, 2.0), st.floats(0.2, 3.0))


@given(BOUNDS, st.lists(st.tuples(BOUNDS, st.floats(0.0, 9.0)), min_size=1, max_size=4), st.floats(0.0, 2.0))
def test_a_distance_falls_by_what_both_robots_cover_and_the_worst_pair_counts(
    own: SpeedBound, others: list[tuple[SpeedBound, float]], time_s: float
) -> None:
    apart = Separation(0.3, 2.0)
    situation = Situation(1, At(x_m=10.0), 0.0)
    situation.peers = [At(x_m=10.0 + far_m, robot_id=number) for number, (_, far_m) in enumerate(others, start=2)]
    each = {number: bound for number, (bound, _) in enumerate(others, start=2)}
    model = PairsBound(apart, own, each)
    reach = model.reach(situation, time_s)
    assert reach <= model.bound(time_s) + 1e-9
    alone = own.bound(time_s)
    left = [far_m - 0.3 - alone - max(alone, bound.bound(time_s)) for bound, far_m in others]
    assert apart.margin(situation) - reach == pytest.approx(min(left))
    # What it takes is at least half of the gap for this robot, which Lemma 4 counts upon.
    assert all(alone <= (alone + max(alone, bound.bound(time_s))) / 2.0 for bound, _ in others)


def test_robots_that_respect_the_same_are_a_fleet_of_equals() -> None:
    alike = {1: TURTLE, 2: replace(TURTLE, body_radius_m=0.3), 3: replace(TURTLE, lease_s=0.4)}
    assert not Peers.of(1, alike, TICK_S).unlike
    made = declare_all(MISSION, HALL, alike)
    assert type(made[1].module("collision").model) is PairBound


def test_every_robot_is_declared_by_its_own_figures_and_pairs_by_both() -> None:
    made = declare_all(MISSION, HALL, PROMISED)
    for robot_id, each in made.items():
        promised = PROMISED[robot_id]
        assert each.recovery.terrain.body_radius_m == promised.body_radius_m
        assert each.recovery.v_max_m_s == promised.v_max_m_s
        assert each.timing.lease_s == promised.lease_s
        model = each.module("collision").model
        assert isinstance(model, PairsBound)
        assert model.own.brake_m_s2 == promised.brake_m_s2
        others = {other: (bound.v_max_m_s, bound.brake_m_s2) for other, bound in model.each.items()}
        assert others == {
            other: (peer.v_max_m_s, peer.brake_m_s2) for other, peer in PROMISED.items() if other != robot_id
        }
    kept = {robot_id: each.module("obstacle").model.bound(1.0) for robot_id, each in made.items()}  # type: ignore[union-attr]
    assert kept[1] < kept[2] < kept[3]


def test_the_fleet_of_the_example_is_proved_and_one_with_weaker_brakes_is_not() -> None:
    admitted = admit(MISSION, HALL, PROMISED)
    assert not admitted.refused
    assert not admitted.unproved
    weaker = {**PROMISED, 3: replace(PROMISED[3], brake_m_s2=1.0)}
    assert admit(MISSION, HALL, weaker).refused
