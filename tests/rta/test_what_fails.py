"""What fails around a robot's supervisor ends with its safe controller, or with a robot that stands."""

from __future__ import annotations

import math

import pytest

from soter.rta import SUPERVISOR
from soter.rta.supervisor import ALARM_S
from soter.sdk import Controller
from tests.rta.doubles import TICK_S, Rig, Unspeakable

ALARM_TICKS = round(ALARM_S / TICK_S)


def test_an_ac_that_raises_loses_control_for_good_and_its_robot_goes_home() -> None:
    rig = Rig("a", "home")
    rig.start()
    rig.ac.failing = True
    calls = rig.tick()
    assert calls == [("drive", None, Controller.AC), ("renew",)], "nothing that it published before it raised is sent"
    rig.ac.failing = False
    rig.tick()
    assert rig.driver() == "home"
    assert rig.watch.records[-1].module == SUPERVISOR
    assert "AC failed" in rig.watch.records[-1].cause
    rig.tick(200)
    assert rig.driver() == "home"
    rig.rules["a"].value = 0.0
    rig.tick()
    assert rig.driver() == "a", "its modules go on judging"


def test_a_failure_reported_from_outside_takes_control_too() -> None:
    rig = Rig("a")
    rig.start()
    rig.robot.fail_ac("the mission ended")
    rig.robot.fail_ac("and something else")
    rig.tick()
    assert rig.driver() == "a"
    assert rig.watch.records[-1].cause == "the mission ended"


@pytest.mark.parametrize(
    "value", [math.nan, OSError("broken"), SystemExit(0), GeneratorExit(), Unspeakable(), -math.inf]
)
def test_a_decision_module_that_fails_takes_control(value: float | BaseException) -> None:
    rig = Rig("a", "b")
    rig.start()
    rig.rules["b"].value = value
    rig.tick()
    assert rig.driver() == "b"
    assert rig.watch.records[-1].module == "b"
    rig.tick(50)
    assert rig.driver() == "b"
    rig.rules["b"].value = 10.0
    rig.tick(3)
    assert rig.driver() is None


def test_a_decision_module_that_fails_says_how_and_once(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig("a")
    rig.start()
    for failure in ("oh", "no"):
        caplog.clear()
        rig.rules["a"].value = ZeroDivisionError(failure)
        rig.tick(50)
        assert [record.levelname for record in caplog.records] == ["ERROR"]
        assert f"ZeroDivisionError('{failure}')" in rig.robot.modules[0].cause
    assert "ZeroDivisionError('oh')" in rig.watch.records[-1].cause


def test_a_safe_controller_that_raises_leaves_the_robot_stopped() -> None:
    rig = Rig("a")
    rig.start()
    rig.rules["a"].value = 0.0
    rig.scs["a"].failing = True
    for _ in range(3):
        calls = rig.tick()
        drives = [call for call in calls if call[0] == "drive"]
        assert drives == [("drive", None, Controller.SC)]
    rig.scs["a"].failing = False
    rig.scs["a"].silent = True
    assert rig.tick() == [("renew",)], "what it published before it raised is never sent"
    rig.scs["a"].silent = False
    assert rig.tick()[0][1].startswith("a ")


def test_a_safe_controller_that_raises_at_every_step_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig("a")
    rig.start()
    rig.rules["a"].value = 0.0
    rig.scs["a"].failing = True
    rig.tick(50)
    assert sum("failed" in record.message for record in caplog.records) == 1


def test_a_safe_controller_that_cannot_engage_leaves_the_robot_stopped() -> None:
    rig = Rig("a")
    rig.start()
    rig.rules["a"].value = 0.0
    rig.scs["a"].failing_to_engage = True
    rig.scs["a"].silent = True
    assert rig.tick() == [("hand_over", Controller.SC, "a"), ("drive", None, Controller.SC), ("renew",)]


def test_a_watch_that_fails_costs_nothing() -> None:
    rig = Rig("a")
    rig.start()
    rig.watch.failing = True
    rig.rules["a"].value = 0.0
    rig.tick()
    assert rig.scs["a"].engaged == 1
    assert rig.names() == ["hand_over", "drive", "renew"]


@pytest.mark.parametrize("mode", [Controller.SC, Controller.AC])
def test_a_hand_over_that_fails_is_repeated_and_the_lease_runs_out_until_it_is_done(mode: Controller) -> None:
    rig = Rig("a")
    rig.start()
    if mode is Controller.AC:
        rig.rules["a"].value = 0.0
        rig.tick()
        rig.rules["a"].value = 10.0
    else:
        rig.rules["a"].value = 0.0
    rig.actuator.failing.add("hand_over")
    for _ in range(5):
        rig.tick()
        assert "hand_over" in rig.names()
        assert "renew" not in rig.names()
    rig.actuator.failing.clear()
    rig.tick()
    assert rig.names()[0] == "hand_over"
    rig.tick()
    assert rig.names() == ["drive", "renew"]
    assert rig.driver() == "a", "an interface that failed is no reason to go back to the AC"


@pytest.mark.parametrize("call", ["drive", "renew"])
def test_an_interface_that_fails_costs_the_ac_control(call: str) -> None:
    rig = Rig("a")
    rig.start()
    rig.actuator.failing.add(call)
    rig.tick()
    assert ("renew" in rig.names()) is (call == "renew")
    rig.tick()
    assert rig.driver() == "a"
    assert rig.watch.records[-1].module == SUPERVISOR


def test_a_stop_that_fails_is_owed_and_the_lease_runs_out_until_the_robot_has_been_told() -> None:
    rig = Rig("a")
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.scs["a"].failing = True
    rig.actuator.failing.add("drive")
    rig.tick()
    rig.scs["a"].failing, rig.scs["a"].silent = False, True
    for _ in range(3):
        assert rig.tick() == [("drive", None, Controller.SC)], "its safe controller has nothing to say any more"
    rig.actuator.failing.clear()
    assert rig.tick() == [("drive", None, Controller.SC), ("renew",)]
    assert rig.tick() == [("renew",)], "once is enough"


def test_what_is_sent_after_a_stop_that_failed_takes_its_place() -> None:
    rig = Rig("a")
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.scs["a"].failing = True
    rig.actuator.failing.add("drive")
    rig.tick()
    rig.scs["a"].failing = False
    rig.actuator.failing.clear()
    assert rig.tick() == [("drive", "a 3", Controller.SC), ("renew",)]
    rig.scs["a"].silent = True
    assert rig.tick() == [("renew",)]


def test_a_hand_over_that_worked_is_not_repeated_for_what_failed_beside_it() -> None:
    rig = Rig("a")
    rig.start()
    rig.tick(2)
    rig.actuator.report = Controller.SC
    rig.actuator.failing.add("insist")
    rig.tick()
    assert rig.names() == ["insist", "hand_over", "drive"], "the lease is left to run out"
    rig.tick()
    assert rig.names() == ["drive", "renew"]
