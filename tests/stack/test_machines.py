"""The mission's machines with a port and a planner that do what the test says."""

from __future__ import annotations

import random
from typing import Any

import pytest

from soter.machine import Event, MachineRef, Runtime
from soter.missions.surveillance import TaskPlanner, Tasks
from soter.rta import ControlReport, GoalReport, Port, Report
from soter.sdk import RobotState, Waypoint
from soter.stack.events import TRIES, Disengaged, GoalEnded, PathPlanned, Place, Reengaged, TargetOutcome
from soter.stack.kit import RobotKit
from soter.stack.planners import PlanRequest
from soter.stack.robot_agent import RETRY_S
from tests.sdk.fake import CAPABILITIES, STATE

TIMEOUT_S = 120.0
PATH = ((1.0, 0.0), (2.0, 0.0), (3.0, 0.0))


class Mission:
    """A task planner and everything below it, for some robots; time and events are moved by the test.

    Attributes:
        goals: waypoints that lie in the ports or were taken from them, by robot: (goal id, waypoint).
        ended: targets that ended: (robot, target, outcome).
        requests: plans asked for.
    """

    def __init__(self, robots: int = 1) -> None:
        self.now_s = 0.0
        self.failures: list[Exception] = []
        self.runtime = Runtime(now=lambda: self.now_s, on_failure=self.failures.append)
        self.listeners: dict[tuple[int, type[Event]], list[MachineRef]] = {}
        self.ports: dict[int, Port[Waypoint, RobotState]] = {}
        self.requests: list[tuple[PlanRequest, MachineRef]] = []
        self.ended: list[tuple[int, int, TargetOutcome]] = []
        self.given: list[tuple[int, int, Place]] = []
        for robot_id in range(1, robots + 1):
            port: Port[Waypoint, RobotState] = Port(robot_id, self.hear)
            port.state = STATE._replace(robot_id=robot_id, x_m=float(robot_id))
            self.ports[robot_id] = port
        kits = {
            robot_id: RobotKit(
                robot_id, port, {other: peer for other, peer in self.ports.items() if other != robot_id},
                lambda request, to: self.requests.append((request, to)), self.subscribe, 5, 0.5, TIMEOUT_S, 0.1,
                CAPABILITIES,
            )
            for robot_id, port in self.ports.items()
        }  # fmt: skip
        tasks = Tasks(
            kits, lambda robot_id: (9.0, float(len(self.given))), lambda *target: self.given.append(target),
            lambda *target: self.ended.append(target),
        )  # fmt: skip
        self.runtime.create(TaskPlanner, tasks)
        self.runtime.run()

    def subscribe(self, robot_id: int, machine: MachineRef, events: tuple[type[Event], ...]) -> None:
        for event in events:
            self.listeners.setdefault((robot_id, event), []).append(machine)

    def hear(self, report: Report) -> None:
        event: Event
        if isinstance(report, ControlReport):
            event = Reengaged() if report.engaged else Disengaged(report.module, report.cause)
        else:
            event = GoalEnded(report.goal_id, report.status)
        for machine in self.listeners.get((report.robot_id, type(event)), ()):
            self.runtime.post(machine, event)

    def run(self, until_s: float | None = None) -> None:
        if until_s is not None:
            self.now_s = until_s
        self.runtime.run()

    def engage(self, robot_id: int = 1) -> None:
        self.ports[robot_id].control(True, "", "")
        self.run()

    def disengage(self, module: str, robot_id: int = 1) -> None:
        self.ports[robot_id].control(False, module, "test")
        self.run()

    def answer(self, path: tuple[Place, ...] = PATH, reason: str | None = None, reaches: bool = True) -> PlanRequest:
        """Answer the oldest request."""
        request, to = self.requests.pop(0)
        self.runtime.post(to, PathPlanned(request.request_id, path, reason, reaches))
        self.run()
        return request

    def take(self, robot_id: int = 1) -> tuple[int, Waypoint] | None:
        request = self.ports[robot_id].take()
        return None if request is None else (request.goal_id, request.command)

    def end_goal(self, status: str, robot_id: int = 1) -> None:
        taken = self.take(robot_id)
        assert taken is not None
        self.hear(GoalReport(robot_id, taken[0], status))
        self.run()

    def outcomes(self) -> list[TargetOutcome]:
        assert self.failures == []
        return [outcome for _, _, outcome in self.ended]


def under_way() -> Mission:
    """Make a mission whose robot drives its first path."""
    mission = Mission()
    mission.engage()
    mission.answer()
    return mission


def test_nothing_is_planned_before_the_ac_has_control() -> None:
    mission = Mission()
    assert mission.given == [(1, 1, (9.0, 0.0))]
    assert mission.requests == []
    mission.engage()
    ((request, _),) = mission.requests
    assert (request.start, request.goal, request.seed) == ((1.0, 0.0), (9.0, 0.0), 5)


def test_a_target_is_reached_waypoint_by_waypoint() -> None:
    mission = under_way()
    for index, place in enumerate(PATH):
        request = mission.ports[1].take()
        assert request is not None
        assert request.command[:2] == place
        assert (request.command.radius_m, request.command.timeout_s) == (0.1, TIMEOUT_S)
        assert [w[:2] for w in request.upcoming] == list(PATH[index + 1 :])
        assert mission.take() is None, "one waypoint at a time"
        mission.hear(GoalReport(1, request.goal_id, "reached"))
        mission.run()
    assert mission.outcomes() == [TargetOutcome.REACHED]
    assert len(mission.given) == 2, "and the next one"
    assert len(mission.requests) == 1


@pytest.mark.parametrize("module", ["geofence", "obstacle"])
def test_a_target_on_whose_way_a_static_rule_stepped_in_is_unsafe(module: str) -> None:
    mission = under_way()
    mission.disengage(module)
    assert mission.outcomes() == [TargetOutcome.UNSAFE]
    assert mission.requests == []
    mission.engage()
    assert mission.requests[0][0].goal == mission.given[1][2]


@pytest.mark.parametrize("module", ["collision", "battery", "supervisor"])
def test_after_the_other_modules_a_target_is_tried_again_three_times_at_most(module: str) -> None:
    mission = under_way()
    for attempt in range(TRIES):
        assert mission.outcomes() == []
        mission.disengage(module)
        if attempt < TRIES - 1:
            mission.engage()
            assert mission.answer().goal == mission.given[0][2]
    assert mission.outcomes() == [TargetOutcome.BLOCKED]
    mission.engage()
    assert mission.requests[0][0].goal == mission.given[1][2]


@pytest.mark.parametrize("status", ["rejected", "superseded", "timed_out", "failed", "cancelled"])
def test_a_waypoint_that_is_not_reached_costs_a_try(status: str) -> None:
    mission = under_way()
    for attempt in range(TRIES):
        mission.end_goal(status)
        if attempt < TRIES - 1:
            assert mission.requests == [], "a little later, as the others may have moved by then"
            mission.run(mission.now_s + 0.99 * RETRY_S)
            assert mission.requests == []
            mission.run(mission.now_s + 0.02 * RETRY_S)
            mission.answer()
    assert mission.outcomes() == [TargetOutcome.BLOCKED]


def test_a_plan_that_fails_or_ends_short_of_the_target_costs_a_try() -> None:
    mission = Mission()
    mission.engage()
    mission.answer((), "no way")
    mission.run(mission.now_s + RETRY_S)
    mission.answer(((1.0, 0.0),), reaches=False)
    mission.end_goal("reached")
    assert mission.outcomes() == []
    mission.run(mission.now_s + RETRY_S)
    mission.answer(((1.0, 0.0),))
    mission.end_goal("reached")
    assert mission.outcomes() == [TargetOutcome.REACHED]


def test_a_target_times_out() -> None:
    mission = under_way()
    mission.run(TIMEOUT_S - 0.01)
    assert mission.outcomes() == []
    mission.run(TIMEOUT_S)
    assert mission.outcomes() == [TargetOutcome.TIMED_OUT]


def test_the_clock_of_a_target_stands_still_while_the_ac_has_no_control() -> None:
    mission = under_way()
    mission.run(50.0)
    mission.disengage("collision")
    mission.run(1000.0)
    assert mission.outcomes() == []
    mission.engage()
    mission.answer()
    mission.run(1000.0 + 69.9)
    assert mission.outcomes() == []
    mission.run(1000.0 + 70.1)
    assert mission.outcomes() == [TargetOutcome.TIMED_OUT]


@pytest.mark.parametrize("late_s", [0.0, 0.03])
def test_losing_control_in_the_tick_in_which_the_time_is_up_costs_nothing_but_the_target(late_s: float) -> None:
    mission = under_way()
    mission.now_s = TIMEOUT_S + late_s
    mission.disengage("collision")
    mission.engage()
    mission.run(mission.now_s + 0.05)
    assert mission.outcomes() == [TargetOutcome.TIMED_OUT]
    assert len(mission.given) == 2


def test_a_disengagement_drops_the_path_and_no_goal_of_it_is_sent_again() -> None:
    mission = under_way()
    first = mission.take()
    assert first is not None
    mission.disengage("collision")
    mission.hear(GoalReport(1, first[0], "preempted"))
    mission.run()
    assert mission.take() is None
    mission.engage()
    assert mission.take() is None, "the planner plans anew from where the robot is"
    mission.answer(((7.0, 7.0),))
    taken = mission.take()
    assert taken is not None
    assert taken[1][:2] == (7.0, 7.0)


def test_a_plan_that_arrives_after_the_disengagement_is_not_driven() -> None:
    mission = Mission()
    mission.engage()
    mission.disengage("collision")
    mission.answer()
    assert mission.take() is None
    mission.engage()
    mission.answer(((7.0, 7.0),))
    taken = mission.take()
    assert taken is not None
    assert taken[1][:2] == (7.0, 7.0)


def test_an_answer_to_an_old_request_is_ignored() -> None:
    mission = Mission()
    mission.engage()
    mission.disengage("collision")
    mission.engage()
    mission.answer(((5.0, 5.0),))
    assert mission.take() is None
    mission.answer(((7.0, 7.0),))
    assert mission.take() is not None


def test_reports_of_unknown_goals_are_ignored() -> None:
    mission = under_way()
    mission.hear(GoalReport(1, 999, "reached"))
    mission.run()
    assert mission.outcomes() == []
    taken = mission.take()
    assert taken is not None
    assert taken[1][:2] == PATH[0]


def test_robots_without_control_nearby_are_planned_around() -> None:
    mission = Mission(3)
    mission.ports[3].state = STATE._replace(robot_id=3, x_m=40.0)
    mission.engage(1)
    assert mission.requests[0][0].discs == ((2.0, 0.0, 0.5),)
    mission.ports[1].state = STATE._replace(robot_id=1, x_m=1.0, vy_m_s=0.2)
    mission.engage(2)
    assert mission.requests[1][0].discs == (), "robot 1 has control and moves on"


def test_a_robot_without_a_state_has_no_plan() -> None:
    mission = Mission()
    mission.ports[1].state = None
    mission.engage()
    assert mission.requests == []
    for attempt in range(1, TRIES):
        mission.run(attempt * RETRY_S)
    assert mission.outcomes() == [TargetOutcome.BLOCKED]


def test_every_robot_has_its_own_targets_and_requests() -> None:
    mission = Mission(3)
    assert [robot_id for robot_id, _, _ in mission.given] == [1, 2, 3]
    for robot_id in (1, 2, 3):
        mission.engage(robot_id)
    assert len({request.request_id for request, _ in mission.requests}) == 3
    mission.disengage("geofence", 2)
    assert mission.ended == [(2, 2, TargetOutcome.UNSAFE)]
    assert mission.given[-1][0] == 2


def storm(mission: Mission, stream: random.Random) -> None:
    """Let anything happen to robot 1, in any order, some of it in one run of the machines."""
    for _ in range(2000):
        port: Any = mission.ports[1]
        draw = stream.random()
        if draw < 0.2:
            port.control(not port.engaged, stream.choice(["collision", "geofence", "battery"]), "")
        elif draw < 0.4 and mission.requests:
            reason = stream.choice([None, None, "no way"])
            request, to = mission.requests.pop(0)
            path = () if reason else PATH[: stream.randrange(1, 4)]
            mission.runtime.post(to, PathPlanned(request.request_id, path, reason, stream.random() < 0.8))
        elif draw < 0.7 and (taken := mission.take()) is not None:
            mission.hear(GoalReport(1, taken[0], stream.choice(["reached", "reached", "preempted", "timed_out"])))
        else:
            mission.now_s += stream.choice([0.05] * 8 + [1.0, 119.97, 120.0])
        if stream.random() < 0.7:
            mission.run()

    mission.run()


def test_whatever_comes_no_machine_fails_and_every_target_ends_once() -> None:
    seen: set[TargetOutcome] = set()
    for seed in range(20):
        mission = Mission()
        storm(mission, random.Random(seed))
        assert mission.failures == []
        ended = [target_id for _, target_id, _ in mission.ended]
        assert ended == list(range(1, len(ended) + 1))
        assert len(mission.given) == len(ended) + 1
        seen.update(mission.outcomes())
    assert seen == set(TargetOutcome)
