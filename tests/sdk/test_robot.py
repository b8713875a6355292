"""Every rule that the template of the narrow interface enforces, whatever an adapter does."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.clock import VirtualClock
from soter.errors import LifecycleError, RobotUnavailable
from soter.sdk import MAX_COORDINATE_M, Controller, Goal, GoalStatus, Link, Robot, Switch, Waypoint
from tests.sdk.fake import FakeRobot, capabilities, ready_robot

AC, SC = Controller.AC, Controller.SC
THERE = Waypoint(2.0, 1.0)
FINITE = ("x_m", "y_m", "z_m", "heading_rad", "vx_m_s", "vy_m_s", "yaw_rate_rad_s", "stamp_s")
BAD_NUMBERS = [math.nan, math.inf, -math.inf, 1.1 * MAX_COORDINATE_M, -1.1 * MAX_COORDINATE_M, 1e300]


# --- names ---------------------------------------------------------------------------------------------------

SETTINGS = {"declared", "stale_after_s", "down_after_s"}
OWN = sorted(name for name in dir(Robot) if not name.startswith("_") and name not in SETTINGS)


def test_an_adapter_may_call_its_own_attributes_what_the_base_class_calls_its_own() -> None:
    class Greedy(FakeRobot):
        def __init__(self) -> None:
            super().__init__()
            private = [name.removeprefix("_Robot_") for name in vars(self) if name.startswith("_Robot__")]
            assert "_goal" in private
            for name in private:
                setattr(self, name, "mine")

        def _admit(self) -> None:
            raise AssertionError("this is the adapter's own")

        _judge = _cancel = _require_ready = _admit

    robot = Greedy()
    robot.init(1.0)
    robot.switch_ac_sc(AC, "test")
    goal = robot.goto(THERE, AC)
    assert goal.active
    assert not robot.goto(THERE, SC).active
    robot.read_state()
    goal.cancel()
    assert goal.status is GoalStatus.CANCELLED


@pytest.mark.parametrize("name", OWN)
def test_what_is_the_same_for_all_robots_is_not_overridden_by_accident(name: str) -> None:
    with pytest.raises(TypeError, match=rf"Mine\.{name} hides soter\.sdk\.Robot\.{name}, .* overrides=\('{name}',\)"):
        type("Mine", (FakeRobot,), {name: None})

    class Mixin:
        pass

    setattr(Mixin, name, None)
    with pytest.raises(TypeError, match=f"hides soter.sdk.Robot.{name}"):
        type("Mine", (Mixin, FakeRobot), {})


@pytest.mark.parametrize("name", OWN)
def test_nor_hidden_by_an_attribute_of_the_object(name: str) -> None:
    class Mine(FakeRobot):
        def __init__(self) -> None:
            super().__init__()
            setattr(self, name, None)

    with pytest.raises((AttributeError, TypeError), match=rf"'{name}'|self\.{name} hides"):
        Robot.init(Mine(), 1.0)


def test_what_is_overridden_on_purpose_is_inherited() -> None:
    class Meant(FakeRobot, overrides=("goto",)):
        def goto(self, target: Waypoint, by: Controller) -> Goal:
            return super().goto(target._replace(z_m=1.0), by)

    class Heir(Meant):
        pass

    assert Heir.goto is Meant.goto


# --- life cycle --------------------------------------------------------------------------------------------


CALLS: dict[str, Callable[[Robot], object]] = {
    "goto": lambda robot: robot.goto(THERE, SC),
    "read_state": lambda robot: robot.read_state(),
    "switch_ac_sc": lambda robot: robot.switch_ac_sc(AC, "test"),
    "renew_lease": lambda robot: robot.renew_lease(),
}


@pytest.mark.parametrize("call", CALLS)
def test_calls_before_init_and_after_close_are_refused_and_touch_nothing(call: str) -> None:
    robot = FakeRobot()
    with pytest.raises(LifecycleError, match=rf"robot 1: {call}\(\) before init"):
        CALLS[call](robot)
    assert robot.calls == []
    robot.init(1.0)
    robot.close(1.0)
    robot.calls.clear()
    with pytest.raises(LifecycleError, match=rf"robot 1: {call}\(\) after close"):
        CALLS[call](robot)
    assert robot.calls == []


def test_capabilities_are_known_after_init_only() -> None:
    robot = FakeRobot()
    with pytest.raises(LifecycleError, match="only after init"):
        _ = robot.capabilities
    robot.init(1.0)
    assert robot.capabilities == robot.found


def test_init_puts_the_sc_in_charge_and_is_done_once() -> None:
    robot = FakeRobot()
    robot.init(1.0)
    assert robot.calls == ["connect", "hand over SC"]
    with pytest.raises(LifecycleError, match=r"init\(\) after init"):
        robot.init(1.0)
    robot.close(1.0)
    with pytest.raises(LifecycleError, match=r"init\(\) after close"):
        robot.init(1.0)


def test_a_robot_that_did_not_connect_can_be_tried_again() -> None:
    robot = FakeRobot()
    robot.failing.add("connect")
    with pytest.raises(OSError, match="connect failed"):
        robot.init(1.0)
    robot.failing.clear()
    robot.init(1.0)
    assert robot.goto(THERE, SC).active


def test_close_is_idempotent_stops_the_goal_and_works_before_init() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.close(1.0)
    robot.close(1.0)
    assert robot.calls.count("disconnect") == 1
    assert goal.status is GoalStatus.CANCELLED
    fresh = FakeRobot()
    fresh.close(1.0)
    assert fresh.calls == ["disconnect"]


def test_a_close_that_fails_is_not_done_twice() -> None:
    robot = ready_robot()
    robot.failing.add("disconnect")
    with pytest.raises(OSError, match="disconnect failed"):
        robot.close(1.0)
    robot.close(1.0)
    assert robot.calls.count("disconnect") == 1


WIDER = {
    "reverses": True, "reports_battery": True, "pivots_first": True, "brake_m_s2": 0.5, "yaw_rate_max_rad_s": 3.0,
    "v_max_m_s": 0.23, "body_radius_m": 0.2, "latency_s": 0.06, "sample_age_s": 0.01, "jitter_s": 0.01,
    "setpoint_period_s": 0.1, "lease_s": 0.2, "tube_m": 0.03, "overshoot_m": 0.02, "position_noise_m": 0.01,
}  # fmt: skip
NARROWER = {
    "reverses": False, "brake_m_s2": 1.01, "v_max_m_s": 0.1, "latency_s": 0.01, "lease_s": 0.05, "tube_m": 0.0,
}  # fmt: skip


@pytest.mark.parametrize("name", WIDER)
def test_a_robot_that_promises_more_than_its_adapter_is_refused_by_name(name: str) -> None:
    modest = {"reverses": False, "reports_battery": False, "pivots_first": False}

    class Modest(FakeRobot):
        declared = capabilities(**modest)

    robot = Modest()
    robot.found = capabilities(**{**modest, name: WIDER[name]})
    with pytest.raises(RobotUnavailable, match=name):
        robot.init(1.0)
    with pytest.raises(LifecycleError):
        robot.goto(THERE, SC)


@pytest.mark.parametrize("name", ["v_max_m_s", "brake_m_s2", "latency_s", "lease_s"])
def test_a_capability_that_is_no_number_is_not_narrower(name: str) -> None:
    robot = FakeRobot()
    robot.found = capabilities(**{name: math.nan})
    with pytest.raises(RobotUnavailable, match=name):
        robot.init(1.0)


@pytest.mark.parametrize("name", NARROWER)
def test_a_robot_may_promise_less(name: str) -> None:
    robot = FakeRobot()
    robot.found = capabilities(**{name: NARROWER[name]})
    robot.init(1.0)
    assert getattr(robot.capabilities, name) == NARROWER[name]


# --- authority ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("in_charge", "other"), [(SC, AC), (AC, SC)])
def test_a_goto_of_the_controller_not_in_charge_is_rejected_and_sends_nothing(
    in_charge: Controller, other: Controller
) -> None:
    robot = ready_robot(in_charge)
    mine = robot.goto(THERE, in_charge)
    robot.calls.clear()
    goal = robot.goto(Waypoint(4.0, 4.0), other)
    assert goal.status is GoalStatus.REJECTED
    assert f"{other} is not in charge" in goal.reason
    assert robot.calls == []
    assert mine.active
    goal.cancel()
    assert robot.calls == []
    assert mine.active


def test_a_name_of_a_controller_is_no_controller() -> None:
    robot = ready_robot(AC)
    assert robot.goto(THERE, cast(Controller, "AC")).status is GoalStatus.REJECTED
    assert robot.calls == []


def test_a_change_preempts_and_hands_over_and_renews_once_each() -> None:
    robot = ready_robot(AC)
    goal = robot.goto(THERE, AC)
    robot.calls.clear()
    switch = robot.switch_ac_sc(SC, "fence")
    assert robot.calls == ["hand over SC", "renew"]
    assert goal.status is GoalStatus.PREEMPTED
    assert "fence" in goal.reason
    assert (switch.to, switch.reason, switch.effective_s) == (SC, "fence", 0.0)
    assert robot.goto(THERE, AC).status is GoalStatus.REJECTED
    assert robot.goto(THERE, SC).active


def test_the_same_controller_again_only_renews() -> None:
    robot = ready_robot(AC)
    goal = robot.goto(THERE, AC)
    robot.calls.clear()
    switch = robot.switch_ac_sc(AC, "still")
    assert robot.calls == ["renew"]
    assert goal.active
    assert switch.effective_s == switch.confirmed_s == 0.0


def test_nothing_but_a_switch_or_a_renewal_renews() -> None:
    robot = ready_robot(SC)
    robot.goto(THERE, SC).cancel()
    robot.goto(THERE, SC)
    robot.read_state()
    assert "renew" not in robot.calls
    robot.renew_lease()
    assert robot.calls[-1] == "renew"


def confirmed(switch: Switch) -> float | None:
    return switch.confirmed_s


def test_a_switch_is_confirmed_by_the_robots_own_report_only() -> None:
    robot = ready_robot(SC)
    switch = robot.switch_ac_sc(AC, "ok")
    robot.time.sleep_until(0.1)
    robot.place(controller=SC)
    robot.read_state()
    assert confirmed(switch) is None
    again = robot.switch_ac_sc(AC, "ok")
    assert again.confirmed_s is None, "repeating a change does not confirm it"
    robot.time.sleep_until(0.2)
    robot.place(controller=AC)
    robot.read_state()
    assert confirmed(switch) == 0.2
    assert robot.switch_ac_sc(AC, "ok").confirmed_s == 0.2


def test_a_report_from_before_the_switch_does_not_confirm_it() -> None:
    robot = ready_robot(SC)
    robot.time.sleep_until(1.0)
    switch = robot.switch_ac_sc(AC, "ok")
    robot.place(controller=AC, stamp_s=0.9)
    robot.read_state()
    assert switch.confirmed_s is None


def test_a_switch_that_fails_has_changed_nothing_and_can_be_repeated() -> None:
    robot = ready_robot(AC)
    goal = robot.goto(THERE, AC)
    robot.failing.add("hand over SC")
    with pytest.raises(OSError, match="hand over"):
        robot.switch_ac_sc(SC, "fence")
    assert goal.active
    assert robot.goto(THERE, SC).status is GoalStatus.REJECTED
    robot.failing.clear()
    robot.calls.clear()
    robot.switch_ac_sc(SC, "fence")
    assert robot.calls == ["hand over SC", "renew"], "the second call must not take it for done"
    assert goal.status is GoalStatus.PREEMPTED


def test_after_a_switch_that_failed_nobody_counts_as_in_charge_already() -> None:
    # What failed here may have reached the vehicle: it then has the AC in charge, whatever is believed here.
    robot = ready_robot(SC)
    robot.failing.add("hand over AC")
    with pytest.raises(OSError, match="hand over"):
        robot.switch_ac_sc(AC, "fine again")
    robot.calls.clear()
    robot.switch_ac_sc(SC, "it failed")
    assert robot.calls == ["hand over SC", "renew"]
    robot.calls.clear()
    robot.switch_ac_sc(SC, "go on")
    assert robot.calls == ["renew"], "now it is known"


# --- targets -----------------------------------------------------------------------------------------------


def refused(robot: FakeRobot, target: object, error: type[Exception]) -> None:
    """Check that a target is refused, sends nothing and leaves the goal before it alone."""
    before = robot.goto(THERE, SC)
    robot.calls.clear()
    with pytest.raises(error):
        robot.goto(cast(Waypoint, target), SC)
    assert robot.calls == []
    assert before.active


@pytest.mark.parametrize("value", BAD_NUMBERS)
@pytest.mark.parametrize("name", ["x_m", "y_m", "z_m"])
def test_coordinates_that_are_not_finite_or_absurd_send_nothing(name: str, value: float) -> None:
    refused(ready_robot(), THERE._replace(**{name: value}), ValueError)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("heading_rad", math.nan), ("heading_rad", math.inf), ("heading_rad", 1e7), ("speed_m_s", 0.0),
        ("speed_m_s", -0.1),
        ("speed_m_s", math.nan), ("speed_m_s", math.inf), ("radius_m", 0.0), ("radius_m", -1.0), ("radius_m", math.nan),
        ("radius_m", math.inf), ("timeout_s", 0.0), ("timeout_s", -1.0), ("timeout_s", math.nan),
        ("timeout_s", math.inf),
    ],
)  # fmt: skip
def test_other_values_out_of_range_send_nothing_and_are_named(name: str, value: float) -> None:
    refused(ready_robot(), THERE._replace(**{name: value}), ValueError)
    with pytest.raises(ValueError, match=rf"Waypoint\.{name} is"):
        THERE._replace(**{name: value}).check()


class Friendly(Waypoint):
    __slots__ = ()

    def check(self, max_coordinate_m: float = 0.0) -> None:
        """Find everything in order."""


class LookAlike:
    x_m = y_m = z_m = 0.0
    heading_rad = speed_m_s = None
    radius_m = timeout_s = 1.0

    def check(self) -> None:
        """Find everything in order."""


@pytest.mark.parametrize(
    "target",
    [
        None, "there", (1.0, 2.0), 7, LookAlike(), Friendly(math.nan, 0.0), THERE._replace(x_m=cast(Any, Decimal(1))),
        THERE._replace(y_m=cast(Any, "1")), THERE._replace(z_m=cast(Any, None)),
        THERE._replace(heading_rad=cast(Any, Decimal(1))), THERE._replace(timeout_s=cast(Any, None)),
        THERE._replace(radius_m=cast(Any, [1.0])),
    ],
)  # fmt: skip
def test_what_only_looks_like_a_waypoint_is_refused_here_and_not_in_the_vehicle(target: object) -> None:
    refused(ready_robot(), target, TypeError)


def test_targets_outside_every_fence_and_numbers_of_other_kinds_are_passed_on() -> None:
    robot = ready_robot()
    robot.goto(Waypoint(-50.0, 9_999.0, heading_rad=9.0, speed_m_s=5.0), SC)
    robot.goto(Waypoint(1, 2), SC)
    robot.goto(Waypoint(cast(Any, Fraction(1, 2)), 0.0), SC)
    assert len(robot.sent) == 3


@given(st.builds(Waypoint, *[st.floats()] * 3, st.none() | st.floats(), st.none() | st.floats(), *[st.floats()] * 2))
def test_whatever_the_numbers_a_target_is_sent_whole_or_not_at_all(target: Waypoint) -> None:
    robot = ready_robot()
    try:
        goal = robot.goto(target, SC)
    except ValueError:
        assert robot.calls == []
    else:
        assert robot.sent == [goal]
        assert all(value is None or math.isfinite(value) for value in target)
        assert math.isfinite(goal.deadline_s)


# --- how goals end -----------------------------------------------------------------------------------------


def test_sent_is_not_reached() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.time.sleep_until(1.0)
    robot.place()
    robot.read_state()
    assert goal.active
    assert goal.ended_s is None


def test_a_new_goal_supersedes_the_one_before() -> None:
    robot = ready_robot()
    first = robot.goto(THERE, SC)
    second = robot.goto(THERE, SC)
    assert first.status is GoalStatus.SUPERSEDED
    assert f"goal {second.id}" in first.reason
    assert second.active
    assert second.id != first.id


@pytest.mark.parametrize("radius_m", [0.005, 0.1, 1.0])
def test_reached_is_judged_from_the_state_with_the_goals_own_radius(radius_m: float) -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(radius_m=radius_m), SC)
    robot.time.sleep_until(1.0)
    robot.place(x_m=2.0, y_m=1.0 + 1.01 * radius_m)
    robot.read_state()
    assert goal.active
    robot.place(x_m=2.0 - 0.99 * radius_m, y_m=1.0)
    robot.read_state()
    assert goal.status is GoalStatus.REACHED
    assert goal.ended_s == 1.0


def test_height_counts() -> None:
    robot = ready_robot()
    goal = robot.goto(Waypoint(0.0, 0.0, 2.0), SC)
    robot.place()
    robot.read_state()
    assert goal.active


def test_a_sample_from_before_the_goal_does_not_reach_it() -> None:
    robot = ready_robot()
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m, stamp_s=0.0)
    robot.time.sleep_until(0.5)
    goal = robot.goto(THERE, SC)
    robot.read_state()
    assert goal.active
    robot.time.sleep_until(0.6)
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m, stamp_s=0.55)
    robot.read_state()
    assert goal.status is GoalStatus.REACHED


def test_cancel_ends_its_own_goal_only() -> None:
    robot = ready_robot()
    first = robot.goto(THERE, SC)
    second = robot.goto(THERE, SC)
    robot.calls.clear()
    first.cancel()
    assert first.status is GoalStatus.SUPERSEDED
    assert second.active
    assert robot.calls == []
    second.cancel()
    assert second.status is GoalStatus.CANCELLED
    second.cancel()
    assert robot.calls == ["halt"]


def test_a_goal_goes_on_until_the_robot_could_be_told_to_stop() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.failing.add("halt")
    for _ in range(2):
        with pytest.raises(OSError, match="halt failed"):
            goal.cancel()
        assert goal.active
    robot.failing.clear()
    goal.cancel()
    assert goal.status is GoalStatus.CANCELLED
    assert robot.calls.count("halt") == 3


def test_a_goal_that_could_not_be_sent_leaves_the_one_before_as_it_was() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    robot.failing.add("send")
    with pytest.raises(OSError, match="send failed"):
        robot.goto(THERE, SC)
    assert goal.active, "it is what the vehicle works on"
    goal.cancel()
    assert robot.calls[-1] == "halt"


def test_a_goal_whose_time_is_up_is_stopped_although_that_fails_at_first() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=1.0), SC)
    robot.time.sleep_until(1.0)
    robot.place()
    robot.failing.add("halt")
    with pytest.raises(OSError, match="halt failed"):
        robot.read_state()
    robot.failing.clear()
    robot.calls.clear()
    robot.read_state()
    assert robot.calls == ["halt"]
    assert goal.status is GoalStatus.TIMED_OUT


def test_a_goal_whose_time_is_up_stops_the_robot() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=2.0), SC)
    robot.time.sleep_until(1.99)
    robot.place()
    robot.read_state()
    assert goal.active
    robot.calls.clear()
    robot.time.sleep_until(2.0)
    robot.read_state()
    assert goal.status is GoalStatus.TIMED_OUT
    assert robot.calls == ["halt"]


def test_a_goal_times_out_although_the_link_is_down() -> None:
    robot = ready_robot()
    goal = robot.goto(THERE._replace(timeout_s=5.0), SC)
    robot.time.sleep_until(6.0)
    assert robot.read_state().link is Link.DOWN
    assert goal.status is GoalStatus.TIMED_OUT


def arrive(robot: FakeRobot) -> None:
    robot.place(x_m=THERE.x_m, y_m=THERE.y_m)
    robot.read_state()


def wait(robot: FakeRobot) -> None:
    robot.time.sleep_until(robot.time.now() + 200.0)
    robot.read_state()


ENDINGS: dict[str, Callable[[FakeRobot, Goal], object]] = {
    "supersede": lambda robot, goal: robot.goto(Waypoint(9.0, 9.0), robot.vehicle_in_charge),
    "preempt": lambda robot, goal: robot.switch_ac_sc(AC if robot.vehicle_in_charge is SC else SC, "test"),
    "cancel": lambda robot, goal: goal.cancel(),
    "arrive": lambda robot, goal: arrive(robot),
    "wait": lambda robot, goal: wait(robot),
}


@given(st.lists(st.sampled_from(sorted(ENDINGS)), min_size=1, max_size=6))
def test_status_leaves_active_once(endings: list[str]) -> None:
    robot = ready_robot()
    goal = robot.goto(THERE, SC)
    seen = []
    for ending in endings:
        ENDINGS[ending](robot, goal)
        seen.append((goal.status, goal.reason, goal.ended_s))
    assert seen[0][0] is not GoalStatus.ACTIVE
    assert set(seen) == {seen[0]}


# --- samples -----------------------------------------------------------------------------------------------


def test_no_sample_yet_is_said_and_not_invented() -> None:
    robot = FakeRobot()
    robot.init(1.0)
    robot.sample = None
    with pytest.raises(RobotUnavailable, match="no valid sample"):
        robot.read_state()


@pytest.mark.parametrize(
    ("age_s", "link"), [(0.0, Link.UP), (0.49, Link.UP), (0.51, Link.STALE), (2.9, Link.STALE), (3.1, Link.DOWN)]
)
def test_the_link_is_judged_by_the_age_of_the_sample(age_s: float, link: Link) -> None:
    robot = ready_robot()
    robot.time.sleep_until(age_s)
    state = robot.read_state()
    assert state.link is link
    assert state.age_s(robot.time.now()) == pytest.approx(age_s)


def test_a_link_comes_back_without_a_restart() -> None:
    robot = ready_robot()
    robot.time.sleep_until(5.0)
    assert robot.read_state().link is Link.DOWN
    robot.place(x_m=1.0)
    state = robot.read_state()
    assert (state.link, state.x_m) == (Link.UP, 1.0)


def test_a_sample_that_stops_coming_keeps_its_stamp() -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.sample = None
    state = robot.read_state()
    assert (state.stamp_s, state.link) == (0.0, Link.STALE)


@pytest.mark.parametrize(
    "values",
    [
        *({name: value} for name in FINITE for value in (math.nan, math.inf, -math.inf)),
        {"vx_m_s": math.inf, "vy_m_s": -math.inf}, {"robot_id": 2}, {"stamp_s": 0.99}, {"stamp_s": -1.0},
        {"battery": -0.01}, {"battery": 1.01}, {"battery": math.nan}, {"stamp_s": 9.0}, {"stamp_s": 1e9},
    ],
)  # fmt: skip
def test_samples_that_cannot_be_are_discarded_and_counted(values: dict[str, Any]) -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.place(x_m=1.0)
    good = robot.read_state()
    robot.time.sleep_until(1.2)
    robot.place(**{"x_m": 2.0, **values})
    assert robot.read_state() == good
    assert robot.discarded == 1
    robot.place(x_m=3.0)
    assert robot.read_state().x_m == 3.0, "one bad sample must not shut out those that follow"


def test_a_clock_that_runs_ahead_a_little_is_forgiven() -> None:
    robot = ready_robot()
    robot.time.sleep_until(1.0)
    robot.place(x_m=1.0, stamp_s=1.05)
    assert robot.read_state().x_m == 1.0


@pytest.mark.parametrize("battery", [None, 0.0, 1.0])
def test_an_unknown_empty_or_full_battery_is_a_sample(battery: float | None) -> None:
    robot = ready_robot()
    robot.place(battery=battery)
    assert robot.read_state().battery == battery
    assert robot.discarded == 0


def test_a_robot_lives_on_its_fleets_clock() -> None:
    clock = VirtualClock()
    robot = FakeRobot(clock=clock)
    robot.init(1.0)
    clock.sleep_until(3.0)
    robot.place()
    assert robot.goto(THERE, SC).sent_s == 3.0
