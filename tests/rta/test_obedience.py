"""A robot that obeys somebody else than it was told to, and what it loses by that (A12)."""

from __future__ import annotations

from soter.rta import (
    Assumption,
)
from soter.sdk import Controller
from tests.rta.alarms import started


def test_a12_a_robot_that_obeys_somebody_else_loses_its_lease_and_is_told_again() -> None:
    rig = started()
    rig.actuator.report = Controller.AC
    rig.tick(10)
    assert rig.robot.log.breaches == {}
    rig.rules["a"].value = 0.0
    rig.tick()
    rig.robot.log.breaches.clear()
    rig.tick()
    assert rig.robot.log.breaches == {}, "it has until the latency has passed"
    for _ in range(5):
        names = [str(call[0]) for call in rig.tick()]
        assert "renew" not in names
        assert names[0] == "insist"
    assert list(rig.robot.log.breaches) == [Assumption.AUTHORITY]
    assert rig.robot.log.breaches[Assumption.AUTHORITY].cause == "the robot reports AC in charge, not SC"
    rig.actuator.report = Controller.SC
    rig.tick()
    assert rig.names()[-1] == "renew"


def test_a12_a_robot_that_calls_itself_the_safe_controllers_while_the_ac_has_it() -> None:
    rig = started()
    rig.actuator.report = Controller.SC
    rig.tick(2)
    assert list(rig.robot.log.breaches) == [Assumption.AUTHORITY]
    assert rig.robot.mode is Controller.SC
    assert rig.watch.records[0].cause.startswith("A12: the robot reports SC in charge")


def test_a12_a_robot_that_no_longer_says_whom_it_obeys_is_not_left_to_the_ac() -> None:
    rig = started()
    rig.actuator.report = Controller.AC
    rig.tick(2)
    assert rig.driver() is None
    rig.actuator.report = None
    rig.tick()
    assert rig.driver() == "a"
    assert rig.watch.records[-1].cause == "A12: the robot does not report any more that AC is in charge"
    # A pilot may have it, and needs no fail-safe to cut in; a robot that starts anew gets ready by its renewals.
    rig.tick(20)
    assert rig.driver() == "a"
    assert "renew" in rig.names()
    assert "insist" not in rig.names()
    rig.actuator.report = Controller.SC
    rig.tick(7)
    assert rig.driver() is None
    rig.actuator.report = Controller.AC
    rig.tick(3)
    assert rig.driver() is None


def test_a12_a_robot_that_reports_nobody_is_not_judged() -> None:
    rig = started()
    rig.rules["a"].value = 0.0
    rig.tick(20)
    assert Assumption.AUTHORITY not in rig.robot.log.breaches
