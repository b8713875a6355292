"""The supervisor's hold on a robot: goals of both controllers, and what the AC is told of its own."""

from __future__ import annotations

from typing import Any

import pytest

from soter.errors import Unsupported
from soter.rta import ControlReport, GoalReport, Port, Report, Request, Topic
from soter.sdk import Controller, Goal, GoalStatus, RobotState, Waypoint
from soter.stack.actuator import PortForwarder, RobotActuator
from tests.rta.doubles import situation
from tests.sdk.fake import FakeRobot, ready_robot

THERE = Waypoint(1.0, 0.0)


class Held:
    """A robot in its supervisor's hand."""

    def __init__(self, mode: Controller = Controller.AC) -> None:
        self.reports: list[Report] = []
        self.robot: FakeRobot = ready_robot(Controller.SC)
        self.port: Port[Waypoint, RobotState] = Port(1, self.reports.append)
        self.actuator = RobotActuator(self.robot, self.port)
        if mode is Controller.AC:
            self.actuator.hand_over(Controller.AC, "line", "")
        self.reports.clear()
        self.robot.calls.clear()

    def ask(self, command: Any = THERE) -> int:
        """Ask through the port and let it be driven; return the goal's number."""
        goal_id = self.port.goto(command)
        request = self.port.take()
        assert request is not None
        self.actuator.drive(request, Controller.AC)
        return goal_id

    def goals(self) -> list[tuple[int, str]]:
        return [(report.goal_id, report.status) for report in self.reports if isinstance(report, GoalReport)]


def test_a_goal_that_is_reached_is_reported_once() -> None:
    held = Held()
    goal_id = held.ask()
    held.actuator.read()
    assert held.goals() == []
    held.robot.time.sleep_until(1.0)
    held.robot.place(x_m=1.0)
    held.actuator.read()
    held.actuator.read()
    assert held.goals() == [(goal_id, "reached")]


def test_a_new_goal_of_the_ac_ends_the_one_before() -> None:
    held = Held()
    first = held.ask()
    held.ask()
    assert held.goals() == [(first, "superseded")]


def test_losing_control_preempts_the_goal_and_is_told_after_that() -> None:
    held = Held()
    goal_id = held.ask()
    held.actuator.hand_over(Controller.SC, "line", "too near")
    assert held.reports == [GoalReport(1, goal_id, "preempted"), ControlReport(1, False, "line", "too near")]
    assert held.robot.vehicle_in_charge is Controller.SC


def test_what_lay_in_the_mailbox_when_control_was_lost_never_moves_anything() -> None:
    held = Held()
    goal_id = held.port.goto(THERE)
    held.actuator.hand_over(Controller.SC, "line", "too near")
    held.actuator.read()
    held.actuator.hand_over(Controller.AC, "line", "")
    assert held.port.take() is None
    assert (goal_id, "rejected") in held.goals()
    assert held.robot.sent == []


@pytest.mark.parametrize("command", [None, "there", Waypoint(float("nan"), 0.0), Waypoint(0.0, 0.0, radius_m=-1.0)])
def test_garbage_is_rejected_and_the_goal_before_goes_on(command: object) -> None:
    held = Held()
    first = held.ask()
    bad = held.ask(command)
    assert held.goals() == [(bad, "rejected")]
    assert "halt" not in held.robot.calls
    held.robot.time.sleep_until(1.0)
    held.robot.place(x_m=1.0)
    held.actuator.read()
    assert held.goals()[-1] == (first, "reached")


def test_what_the_robot_does_not_support_is_rejected_and_the_goal_before_goes_on() -> None:
    held = Held()
    first = held.ask()

    def refuse(goal: Goal) -> None:
        raise Unsupported("it stays on the ground")

    send, held.robot._send_goto = held.robot._send_goto, refuse  # type: ignore[method-assign]
    second = held.ask(Waypoint(1.0, 0.0, 5.0))
    assert held.goals() == [(second, "rejected")]
    held.robot._send_goto = send  # type: ignore[method-assign]
    held.ask()
    assert held.goals()[1:] == [(first, "superseded")]


@pytest.mark.parametrize("mode", [Controller.AC, Controller.SC])
def test_a_stop_is_sent_where_the_goal_has_been_reached_since_the_vehicle_drives_on_to_its_middle(
    mode: Controller,
) -> None:
    held = Held(mode)
    if mode is Controller.AC:
        held.ask()
    else:
        held.actuator.drive(THERE, mode)
    held.robot.time.sleep_until(1.0)
    held.robot.place(x_m=0.95)
    held.actuator.read()
    assert held.actuator.goal is None
    held.actuator.drive(None, mode)
    held.actuator.drive(None, mode)
    assert held.robot.calls.count("halt") == 1


def test_a_stop_after_a_hand_over_has_nothing_left_to_stop() -> None:
    held = Held()
    held.ask()
    held.actuator.hand_over(Controller.SC, "line", "too near")
    held.actuator.drive(None, Controller.SC)
    assert "halt" not in held.robot.calls


def test_a_stop_that_fails_can_be_repeated() -> None:
    held = Held()
    goal_id = held.ask()
    held.robot.failing.add("halt")
    with pytest.raises(OSError, match="halt failed"):
        held.actuator.drive(None, Controller.AC)
    held.robot.place()
    held.actuator.read()
    held.robot.failing.clear()
    held.actuator.drive(None, Controller.AC)
    assert held.robot.calls.count("halt") == 2
    assert held.goals() == [(goal_id, "cancelled")]


def test_a_stop_reaches_what_the_robot_works_on_although_a_newer_goal_could_not_be_sent() -> None:
    held = Held()
    held.ask()
    held.robot.failing.add("send")
    with pytest.raises(OSError, match="send failed"):
        held.ask()
    held.actuator.read()
    held.actuator.drive(None, Controller.AC)
    assert held.robot.calls[-1] == "halt"


def test_the_scs_goals_are_not_the_acs_business() -> None:
    held = Held(Controller.SC)
    held.actuator.drive(THERE, Controller.SC)
    assert held.robot.sent[-1].by is Controller.SC
    held.actuator.drive(Waypoint(2.0, 0.0), Controller.SC)
    held.actuator.drive(None, Controller.SC)
    held.actuator.read()
    assert held.reports == []


def test_stop_cancels_the_goal_and_only_where_there_is_one() -> None:
    held = Held()
    goal_id = held.ask()
    held.actuator.drive(None, Controller.AC)
    held.actuator.drive(None, Controller.AC)
    assert held.robot.calls.count("halt") == 1
    assert held.goals() == [(goal_id, "cancelled")]
    assert held.robot.sent[-1].status is GoalStatus.CANCELLED


def test_reading_shows_the_ac_the_state_and_renewing_renews() -> None:
    held = Held()
    held.robot.place(x_m=7.0)
    state = held.actuator.read()
    assert held.port.state is state
    assert state.x_m == 7.0
    held.actuator.renew()
    assert held.robot.calls == ["renew"]


def test_the_forwarder_publishes_what_lies_in_the_mailbox_once() -> None:
    port: Port[Waypoint, RobotState] = Port(1, lambda report: None)
    topic: Topic[Any] = Topic("waypoint")
    forwarder = PortForwarder(port, topic, 0.05)
    forwarder.step(situation())
    assert topic.count == 0
    port.goto(THERE)
    forwarder.step(situation())
    forwarder.step(situation())
    assert topic.count == 1
    assert isinstance(topic.value, Request)
    assert forwarder.request is topic.value
    forwarder.engage(situation())
    assert forwarder.request is None


class Traitor(float):
    """Passes every check, and fails whoever computes with it."""

    def __sub__(self, other: object) -> float:
        raise ArithmeticError("no")

    __rsub__ = __sub__


def test_a_number_that_fails_whoever_computes_with_it_reaches_no_robot() -> None:
    held = Held()
    held.ask(Waypoint(Traitor(2.5), 1.0))
    goal = held.actuator.goal
    assert goal is not None
    assert goal.target == Waypoint(2.5, 1.0)
    assert all(type(value) is float or value is None for value in goal.target)


def test_a_number_that_is_too_large_for_a_float_is_refused() -> None:
    held = Held()
    goal_id = held.ask(Waypoint(10**400, 1.0))
    assert held.goals() == [(goal_id, "rejected")]
    assert held.robot.calls == []
