"""Every rule that the template of the narrow interface enforces, whatever an adapter does."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import pytest

from soter.errors import LifecycleError, RobotUnavailable
from soter.sdk import Controller, Goal, GoalStatus, Robot, Switch, Waypoint
from tests.sdk.fake import FakeRobot, capabilities, ready_robot

AC, SC = Controller.AC, Controller.SC
THERE = Waypoint(2.0, 1.0)


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
