"""Who makes way before two robots meet. Nothing here keeps them apart; it keeps the module from having to."""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, nan, pi, sin
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.config import load_mission
from soter.rta import GoalReport, Port
from soter.runner import run_mission
from soter.sdk import Link, RobotState, Waypoint
from soter.stack.encounters import AHEAD_S, LOOK_S, Duty, duty, has_to_wait, looks_again_s
from soter.stack.events import TargetOutcome
from soter.stack.kit import RobotKit
from soter.stack.robot_agent import SET_OFF_S
from tests.sdk.fake import CAPABILITIES, STATE
from tests.stack.test_machines import TIMEOUT_S, Mission

EXAMPLES = Path(__file__).parents[2] / "examples"
APART_M = 0.5


def at(robot_id: int, x_m: float, y_m: float, vx_m_s: float = 0.0, vy_m_s: float = 0.0) -> RobotState:
    return STATE._replace(robot_id=robot_id, x_m=x_m, y_m=y_m, vx_m_s=vx_m_s, vy_m_s=vy_m_s)


def kit_of(own: RobotState, *others: RobotState, engaged: bool = True) -> RobotKit:
    ports: dict[int, Port[Waypoint, RobotState]] = {}
    for state in (own, *others):
        ports[state.robot_id] = Port(state.robot_id, lambda _: None)
        ports[state.robot_id].state, ports[state.robot_id].engaged = state, engaged
    port = ports.pop(own.robot_id)
    return RobotKit(
        own.robot_id, port, ports, lambda *_: None, lambda *_: None, 1, APART_M, TIMEOUT_S, 0.1, CAPABILITIES
    )


def owed(own: RobotState, *others: RobotState, engaged: bool = True) -> Duty:
    return duty(kit_of(own, *others, engaged=engaged), own)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (at(1, 1.0, 0.0, -0.2), Duty.WAIT),
        (at(1, 0.6, -0.6, 0.0, 0.2), Duty.WAIT),
        (at(3, 1.0, 0.0, -0.2), Duty.NONE),
        (at(1, 1.0, 0.0, 0.2), Duty.NONE),
        (at(1, -1.0, 0.0, 0.2), Duty.NONE),
        (at(1, 3.0, 0.0, -0.2), Duty.NONE),
        (at(1, 0.8, 0.6, -0.2), Duty.NONE),
        (at(1, 0.7, 0.0), Duty.GO_ROUND),
        (at(3, 0.7, 0.0), Duty.GO_ROUND),
        (at(3, 0.7, 0.49), Duty.NONE),
        (at(1, 0.7, 0.0)._replace(yaw_rate_rad_s=-1.0), Duty.WAIT),
        (at(3, 0.7, 0.0)._replace(yaw_rate_rad_s=1.0), Duty.NONE),
    ],
    ids=["head on", "crossing", "of a higher id", "ahead and as fast", "behind", "far", "past it", "stands",
         "stands, of a higher id", "stands beside the way", "turns", "turns, of a higher id"],
)  # fmt: skip
def test_what_a_robot_owes_another(other: RobotState, expected: Duty) -> None:
    assert owed(at(2, 0.0, 0.0, 0.2), other) is expected


def test_one_whose_ac_has_no_control_is_driven_round_however_it_moves() -> None:
    assert owed(at(2, 0.0, 0.0, 0.2), at(1, 0.8, 0.0, -0.2), engaged=False) is Duty.GO_ROUND


def test_one_that_is_not_heard_any_more_is_waited_for_by_nobody() -> None:
    own, gone = at(2, 0.0, 0.0, 0.2), at(1, 0.8, 0.0, -0.2)._replace(link=Link.DOWN)
    assert owed(own, gone) is Duty.GO_ROUND
    assert not has_to_wait(kit_of(own, gone), own)


def test_one_that_has_not_been_heard_is_nobody() -> None:
    own = at(2, 0.0, 0.0, 0.2)
    kit = kit_of(own, at(1, 1.0, 0.0, -0.2))
    kit.peers[1].state = None
    assert duty(kit, own) is Duty.NONE
    assert not has_to_wait(kit, own)


DIRECTIONS = st.floats(-pi, pi)


def two_robots(
    apart_m: float, there: float, to_1: float, to_2: float, v_1_m_s: float, v_2_m_s: float
) -> tuple[RobotState, RobotState]:
    """Return robot 1, and robot 2 in the direction `there` of it, each on its way in a direction of its own."""
    one = at(1, 0.0, 0.0, v_1_m_s * cos(to_1), v_1_m_s * sin(to_1))
    two = at(2, apart_m * cos(there), apart_m * sin(there), v_2_m_s * cos(to_2), v_2_m_s * sin(to_2))
    return one, two


@given(st.floats(0.3, 3.0), DIRECTIONS, DIRECTIONS, DIRECTIONS, st.floats(0.05, 0.22), st.floats(0.05, 0.22))
def test_of_two_that_are_about_to_meet_just_the_one_with_the_higher_id_waits(
    apart_m: float, there: float, to_1: float, to_2: float, v_1_m_s: float, v_2_m_s: float
) -> None:
    one, two = two_robots(apart_m, there, to_1, to_2, v_1_m_s, v_2_m_s)
    steps = [AHEAD_S * step / 200 for step in range(201)]
    gaps_m = [
        hypot(two.x_m - one.x_m + t * (two.vx_m_s - one.vx_m_s), two.y_m - one.y_m + t * (two.vy_m_s - one.vy_m_s))
        for t in steps
    ]
    assume(abs(min(gaps_m) - 0.95 * APART_M) > 0.01)
    assume(abs(gaps_m[1] - gaps_m[0]) > 1e-12)  # side by side, rounding decides whether they come nearer
    meet = min(gaps_m) < 0.95 * APART_M and gaps_m[1] < gaps_m[0]
    assert owed(one, two) is Duty.NONE
    assert owed(two, one) is (Duty.WAIT if meet else Duty.NONE)


def waiting() -> Mission:
    """Make a mission whose robot 2 drives at robot 1, which comes towards it, and waits."""
    mission = Mission(2)
    for robot_id in (1, 2):
        mission.engage(robot_id)
        mission.answer()
    mission.ports[1].state, mission.ports[2].state = at(1, 0.0, 0.0, 0.2), at(2, 1.0, 0.0, -0.2)
    assert mission.take(2) is not None
    mission.run(LOOK_S)
    assert mission.take(2) is None, "it has no velocity yet that counts"
    mission.run(SET_OFF_S + LOOK_S)
    return mission


def test_who_waits_stops_as_soon_as_it_can_and_goes_on_when_the_other_is_past() -> None:
    mission = waiting()
    taken = mission.take(2)
    assert taken is not None
    assert taken[1][:2] == pytest.approx((1.0 - 0.2**2 / 2.0, 0.0))
    mission.hear(GoalReport(2, taken[0], "reached"))
    mission.ports[2].state = at(2, 0.98, 0.0)
    mission.run(2.0)
    assert (mission.requests, mission.take(2)) == ([], None)
    mission.ports[1].state = at(1, 0.98, 0.6, 0.2, 0.2)
    mission.run(2.3)
    assert mission.answer().robot_id == 2
    assert mission.take(2) is not None
    assert mission.outcomes() == []


def test_who_waits_for_one_that_then_stands_plans_round_it() -> None:
    mission = waiting()
    mission.ports[1].state = at(1, 0.4, 0.0)
    mission.run(2.0)
    assert [request.discs for request, _ in mission.requests] == [((0.4, 0.0, APART_M),)]


def test_who_waits_is_still_taken_by_a_module_and_its_target_still_runs_out_of_time() -> None:
    mission = waiting()
    mission.disengage("collision", 2)
    mission.requests.clear()
    mission.run(3.0)
    assert [request for request, _ in mission.requests if request.robot_id == 2] == []
    mission.requests.clear()
    mission.engage(2)
    assert mission.answer().robot_id == 2
    other = waiting()
    other.run(TIMEOUT_S + 1.0)
    assert (2, TargetOutcome.TIMED_OUT) in [(robot_id, outcome) for robot_id, _, outcome in other.ended]


def test_what_no_robot_can_say_of_itself_is_no_encounter_and_fails_nobody() -> None:
    own = at(2, 0.0, 0.0, 0.2)
    for far_m, v_m_s in ((1e300, -1e300), (1.0, -1e300), (1e300, 0.0)):
        assert owed(own, at(1, far_m, far_m, v_m_s, v_m_s)) in Duty


def test_two_in_a_small_room_are_seldom_taken_because_of_each_other() -> None:
    mission = load_mission(
        EXAMPLES / "surveillance.toml", {"backend": "kinematic", "targets": "grid", "seed": 2, "duration_s": 600.0}
    )
    result = run_mission(mission).result
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    # Without anybody making way it is 24 times.
    assert result.disengagements["collision"] <= 6


@given(st.floats(0.0, 8.0), DIRECTIONS, DIRECTIONS, DIRECTIONS, st.floats(0.0, 0.22), st.floats(0.0, 0.22))
def test_no_encounter_is_missed_by_looking_later(
    apart_m: float, there: float, to_1: float, to_2: float, v_1_m_s: float, v_2_m_s: float
) -> None:
    one, two = two_robots(apart_m, there, to_1, to_2, v_1_m_s, v_2_m_s)
    kit = replace(kit_of(two, one), peers_v_max_m_s=CAPABILITIES.v_max_m_s)
    later_s = looks_again_s(kit, two)
    assert later_s >= LOOK_S
    if later_s == LOOK_S:
        return
    # Until the look that is left out last, straight at each other is the worst that the two can do.
    gap_m = apart_m - (later_s - LOOK_S) * (kit.promised.v_max_m_s + kit.peers_v_max_m_s)
    ahead = at(1, 0.0, 0.0, CAPABILITIES.v_max_m_s), at(2, gap_m, 0.0, -CAPABILITIES.v_max_m_s)
    assert duty(kit_of(ahead[1], ahead[0]), ahead[1]) is Duty.NONE


def test_while_a_peer_is_not_heard_of_or_its_speed_is_not_known_every_look_counts() -> None:
    far, own = at(1, 50.0, 0.0), at(2, 0.0, 0.0)
    kit = kit_of(own, far)
    assert looks_again_s(kit, own) == LOOK_S, "what the peer promises is not known"
    kit = replace(kit, peers_v_max_m_s=1.0)
    assert looks_again_s(kit, own) > LOOK_S
    kit.peers[1].state = far._replace(x_m=nan)
    assert looks_again_s(kit, own) == LOOK_S
    kit.peers[1].state = None
    assert looks_again_s(kit, own) == LOOK_S
