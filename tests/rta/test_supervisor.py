"""One robot under supervision: who drives, what is sent, and that every failure ends with the safe controller."""

from __future__ import annotations

import math

import pytest

from soter.rta import SUPERVISOR, Sample, SpeedBound, Timing
from soter.rta.supervisor import ALARM_S
from soter.sdk import Controller
from tests.rta.doubles import TICK_S, At, Rig

ALARM_TICKS = round(ALARM_S / TICK_S)


def at(rig: Rig, x_m: float) -> None:
    rig.actuator.sample = At(x_m, stamp_s=rig.now_s)


# --- start, and the order of driving -----------------------------------------------------------------------


def test_a_robot_starts_in_sc_and_is_given_to_the_ac_when_all_modules_agree() -> None:
    rig = Rig("a", "b")
    rig.rules["b"].value = 0.0
    rig.tick(20)
    assert rig.driver() == "b"
    assert rig.robot.mode is Controller.SC
    assert rig.ac.steps == 0
    rig.rules["b"].value = 10.0
    assert rig.tick() == [("hand_over", Controller.AC, "b"), ("drive", "ac 1", Controller.AC), ("renew",)]


def test_without_modules_the_ac_drives_from_the_first_tick_and_is_told_so_once() -> None:
    rig = Rig()
    assert rig.tick() == [("hand_over", Controller.AC, ""), ("drive", "ac 1", Controller.AC), ("renew",)]
    assert rig.tick() == [("drive", "ac 2", Controller.AC), ("renew",)]


def test_without_modules_a_robot_without_a_state_is_stopped() -> None:
    rig = Rig()
    rig.tick(3)
    rig.ac.silent = True
    rig.actuator.sample = OSError("gone")
    assert ("drive", None, Controller.AC) in rig.tick()


def test_the_highest_module_in_sc_drives() -> None:
    rig = Rig("a", "b", "c")
    rig.start()
    rig.rules["c"].value = 0.0
    rig.tick()
    assert rig.driver() == "c"
    rig.rules["a"].value = 0.0
    rig.tick()
    assert rig.driver() == "a"
    rig.rules["b"].value = 0.0
    rig.tick()
    assert rig.driver() == "a"
    rig.rules["a"].value = 10.0
    rig.tick()
    assert rig.driver() == "b"
    assert [rig.scs[name].engaged for name in "abc"] == [1, 1, 1]


# --- attribution -------------------------------------------------------------------------------------------


def test_a_disengagement_belongs_to_the_first_module_that_fired_and_others_have_joined() -> None:
    rig = Rig("a", "b", "c")
    rig.start()
    rig.rules["b"].value = rig.rules["c"].value = 0.0
    rig.tick()
    (record,) = rig.watch.records
    assert (record.before, record.after, record.module, record.joined) == (None, "b", "b", ("c",))
    assert record.cause.startswith("margin 0.000 m < reach")
    assert record.time_s == pytest.approx(rig.now_s - TICK_S)
    rig.rules["a"].value = 0.0
    rig.tick()
    record = rig.watch.records[-1]
    assert (record.before, record.after, record.module) == ("b", "a", "a"), "a change of driver is no disengagement"
    assert len(rig.watch.records) == 2


def test_a_lower_module_that_fires_while_another_drives_changes_nothing() -> None:
    rig = Rig("a", "b")
    rig.start()
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.rules["b"].value = 0.0
    calls = rig.tick()
    assert len(rig.watch.records) == 1
    assert [call[0] for call in calls] == ["drive", "renew"]
    assert rig.modules["b"].mode is Controller.SC, "it keeps judging whoever drives"


def test_a_release_is_recorded_with_the_last_module_that_released() -> None:
    rig = Rig("a")
    rig.start()
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.rules["a"].value = 10.0
    rig.tick()
    record = rig.watch.records[-1]
    assert (record.before, record.after, record.module) == ("a", None, "a")


# --- what is sent ------------------------------------------------------------------------------------------


def test_a_disengagement_is_one_hand_over_then_the_scs_command_then_the_lease() -> None:
    rig = Rig("a")
    rig.start()
    rig.rules["a"].value = 0.0
    steps = rig.scs["a"].steps
    assert rig.tick() == [("hand_over", Controller.SC, "a"), ("drive", f"a {steps + 1}", Controller.SC), ("renew",)]


def test_a_change_between_safe_controllers_flushes_the_goal() -> None:
    rig = Rig("a", "b")
    rig.start()
    rig.rules["b"].value = 0.0
    rig.tick()
    rig.rules["a"].value = 0.0
    rig.scs["a"].silent = True
    assert rig.tick() == [("drive", None, Controller.SC), ("renew",)]


def test_a_command_is_sent_once() -> None:
    rig = Rig("a")
    rig.start()
    rig.ac.silent = True
    assert rig.tick() == [("renew",)]
    rig.topic.publish("new")
    assert rig.tick() == [("drive", "new", Controller.AC), ("renew",)]
    assert rig.tick() == [("renew",)]


def test_what_the_other_controller_published_last_is_never_sent() -> None:
    rig = Rig("a")
    rig.start()
    rig.scs["a"].silent = True
    rig.topic.publish("stale")
    rig.rules["a"].value = 0.0
    assert [call[0] for call in rig.tick()] == ["hand_over", "renew"]
    assert rig.tick() == [("renew",)]
    rig.topic.publish("of the safe controller")
    rig.ac.silent = True
    rig.rules["a"].value = 10.0
    assert [call[0] for call in rig.tick()] == ["hand_over", "renew"]


def test_the_lease_is_renewed_once_a_tick_and_last() -> None:
    rig = Rig("a")
    for value in (10.0, 0.0, 10.0, math.nan, 10.0, OSError("broken")):
        rig.rules["a"].value = value
        for _ in range(10):
            rig.tick()
            assert rig.names().count("renew") == 1
            assert rig.names()[-1] == "renew"


# --- samples -----------------------------------------------------------------------------------------------


class OddModel(SpeedBound):
    """A model of the user's own that fails when it is asked about a sample."""

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        if after.x_m > 10.0:
            raise ZeroDivisionError("an odd model")
        return True


def test_a_model_that_fails_at_a_sample_costs_the_ac_control_and_nobody_else() -> None:
    rig = Rig("a", models=(OddModel(0.22, 1.0),))
    rig.start()
    at(rig, 10.001)
    rig.tick()
    assert rig.driver() == "a"
    assert "an odd model" in rig.watch.records[-1].cause
    at(rig, 10.0)
    rig.tick(ALARM_TICKS + 1)
    assert rig.driver() is None


def test_a_report_of_who_is_in_charge_that_makes_no_sense_costs_the_ac_control(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig("a")
    rig.start()

    def senseless(sample: Sample) -> Controller | None:
        raise KeyError("the pilot")

    monkeypatch.setattr(rig.actuator, "reported", senseless)
    rig.tick()
    assert rig.driver() == "a"
    assert "the pilot" in rig.watch.records[-1].cause


def test_a_sample_outside_the_reach_set_takes_control_for_a_while() -> None:
    rig = Rig("a")
    rig.start()
    at(rig, 10.5)
    rig.tick()
    assert rig.driver() == "a"
    assert rig.watch.records[-1].module == SUPERVISOR
    assert "reach set of SpeedBound" in rig.watch.records[-1].cause
    assert rig.modules["a"].mode is Controller.AC, "it costs the modules nothing of what they know"
    rig.tick(ALARM_TICKS - 1)
    assert rig.driver() == "a"
    rig.tick(2)
    assert rig.driver() is None


def test_a_robot_that_moves_as_fast_as_declared_raises_no_alarm() -> None:
    rig = Rig("a")
    rig.start()
    x_m = 10.0
    for _ in range(100):
        x_m += 0.22 * TICK_S
        at(rig, x_m)
        rig.tick()
        assert rig.driver() is None


def test_after_an_alarm_every_module_has_looked_before_the_ac_gets_control() -> None:
    rig = Rig("a", "slow", deltas=[TICK_S, 20.0])
    rig.start()
    # What moved the robot away was never seen by the slow module, which looks every 20 s.
    rig.rules["slow"].value = 0.0
    at(rig, 11.0)
    rig.tick(ALARM_TICKS + 10)
    assert rig.driver() == "slow"


@pytest.mark.parametrize("sample", [OSError("link lost"), At(math.nan), At(0.0, math.inf), At(10.0, stamp_s=math.nan)])
def test_no_state_or_one_that_is_no_number_takes_control(sample: At | Exception) -> None:
    rig = Rig("a")
    rig.start()
    rig.fresh = False
    rig.actuator.sample = sample
    before = rig.robot.situation.own
    rig.tick(3)
    assert rig.driver() == "a"
    assert rig.watch.records[-1].module == SUPERVISOR
    assert "no state" in rig.watch.records[-1].cause
    assert rig.robot.situation.own is before
    assert rig.robot.situation.age_s == pytest.approx(3 * TICK_S)


def test_a_stale_sample_takes_control_and_its_age_is_known() -> None:
    rig = Rig("a", timing=Timing(latency_s=0.05, sample_age_s=0.1))
    rig.start()
    rig.fresh = False
    rig.actuator.sample = At(10.0, stamp_s=rig.now_s - TICK_S)
    rig.tick(2)
    assert rig.driver() is None, "as old as declared"
    rig.tick()
    assert rig.driver() == "a"
    assert "sample is 0.150 s old, declared at most 0.100 s" in rig.watch.records[-1].cause


def test_a_stamp_ahead_of_the_clock_does_not_shrink_the_reach_bound() -> None:
    rig = Rig("a")
    rig.start()
    rig.fresh = False
    rig.actuator.sample = At(10.0, stamp_s=rig.now_s + 5.0)
    rig.rules["a"].value = 0.01
    rig.tick()
    assert rig.robot.situation.age_s == 0.0
    assert rig.driver() == "a"


def test_a_look_later_than_declared_takes_control() -> None:
    rig = Rig("a", "b", deltas=[TICK_S, 0.5], timing=Timing(latency_s=0.05, jitter_s=0.02))
    rig.start()
    rig.ticks += 1  # one tick is left out
    rig.tick()
    assert rig.driver() == "a"
    assert rig.watch.records[-1].module == SUPERVISOR
    assert "'a' looked after 0.100 s, not 0.05 s" in rig.watch.records[-1].cause
    assert all(module.mode is Controller.AC for module in rig.robot.modules), "a late look says nothing about margins"


# --- Delta -------------------------------------------------------------------------------------------------


def test_every_module_looks_once_a_delta_and_at_the_first_tick() -> None:
    rig = Rig("fast", "slow", deltas=[TICK_S, 0.5])
    rig.start()
    while rig.ticks % 10 != 1:
        rig.tick()
    rig.rules["slow"].value = 0.0
    rig.tick(9)
    assert rig.driver() is None
    rig.tick()
    assert rig.driver() == "slow"
    rig.rules["slow"].value = 10.0
    rig.rules["fast"].value = 0.0
    rig.tick()
    assert rig.driver() == "fast"
