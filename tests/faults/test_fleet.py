"""A fleet behind faults is a fleet: life cycle, promises, clock, and what only some vehicles can be made to do."""

from __future__ import annotations

import pytest

from soter.clock import VirtualClock
from soter.errors import LifecycleError, RobotUnavailable, Unsupported
from soter.faults import FaultyFleet, FaultyRobot, Impairable, read_faults
from soter.sdk import Controller, GoalStatus, Link, RobotSpec, Waypoint
from tests.faults.bench import Bench, FakeFleet, ImpairableRobot, fleet_of, mission
from tests.sdk.fake import FakeRobot, capabilities

VEHICLE = (
    {"kind": "wheel_slip", "left": 0.95},
    {"kind": "weak_brakes", "factor": 0.8},
    {"kind": "kill", "start_s": 1.0},
)


def test_robots_without_faults_are_what_they_were() -> None:
    fleet = fleet_of({"kind": "kill", "robot": 2, "start_s": 1.0}, robots=3, kind=ImpairableRobot)
    assert [type(robot) is ImpairableRobot for robot in fleet.robots] == [True, False, True]
    assert [robot.id for robot in fleet.robots] == [1, 2, 3]


@pytest.mark.parametrize("table", VEHICLE, ids=lambda table: table["kind"])
def test_faults_of_the_vehicle_need_a_vehicle_that_has_them(table: dict[str, object]) -> None:
    with pytest.raises(Unsupported, match=f"kind '{table['kind']}' needs a vehicle .* FakeRobot cannot; use"):
        fleet_of(table)
    assert isinstance(fleet_of(table, kind=ImpairableRobot).robots[0], FaultyRobot)
    assert isinstance(ImpairableRobot(), Impairable)


def test_each_robot_declares_what_its_own_faults_leave_of_the_promises() -> None:
    fleet = fleet_of({"kind": "delay", "commands_s": 0.03, "robot": 1}, {"kind": "bias", "x_m": 0.1}, robots=2)
    first, second = (robot.declared for robot in fleet.robots)
    assert (first.latency_s, second.latency_s) == pytest.approx((0.08, 0.05))
    assert (first.position_noise_m, second.position_noise_m) == pytest.approx((0.1, 0.1))
    for robot in fleet.robots:
        robot.init(1.0)
        assert robot.capabilities == robot.declared


def test_a_robot_that_promises_less_than_its_class_is_refused_as_before() -> None:
    fleet = fleet_of({"kind": "bias", "x_m": 0.1})
    robot = fleet.robots[0]
    assert isinstance(robot, FaultyRobot)
    assert isinstance(robot.inner, FakeRobot)
    robot.inner.found = capabilities(latency_s=1.0)
    with pytest.raises(RobotUnavailable, match=r"latency_s is 1\.0, promised 0\.05"):
        robot.init(1.0)


def test_weak_brakes_and_slipping_wheels_are_promised() -> None:
    before = Bench({"kind": "battery", "offset": -0.1}).robot.capabilities
    weak = Bench({"kind": "weak_brakes", "factor": 0.5}, kind=ImpairableRobot).robot.capabilities
    assert weak.brake_m_s2 == pytest.approx(0.5)
    assert weak.overshoot_m - before.overshoot_m == pytest.approx(0.22**2 / 2)
    assert weak.tube_m - before.tube_m == pytest.approx(0.22**2 / 2)
    slips = Bench({"kind": "wheel_slip", "left": 0.95}, kind=ImpairableRobot).robot.capabilities
    assert slips.tube_m - before.tube_m == pytest.approx(0.01)


def test_the_vehicle_is_impaired_while_the_faults_are_on_and_whole_at_the_end() -> None:
    bench = Bench(
        {"kind": "wheel_slip", "left": 0.9, "right": 0.9, "start_s": 1.0, "duration_s": 1.0},
        {"kind": "wheel_slip", "left": 0.5, "right": 0.5, "start_s": 1.5, "duration_s": 1.0},
        {"kind": "weak_brakes", "factor": 0.5, "start_s": 1.5},
        kind=ImpairableRobot,
    )
    behind = bench.behind
    assert isinstance(behind, ImpairableRobot)
    seen = []
    for at_s in (0.5, 1.0, 1.6, 2.2, 2.6):
        bench.look(at_s)
        seen.append(behind.impaired)
    assert seen == [
        (1.0, 1.0, 1.0, True),
        (0.9, 0.9, 1.0, True),
        (0.45, 0.45, 0.5, True),
        (0.5, 0.5, 0.5, True),
        (1.0, 1.0, 0.5, True),
    ]
    bench.fleet.close()
    assert behind.impaired == (1.0, 1.0, 1.0, True)


def test_a_killed_robot_is_gone_and_comes_back_without_a_memory() -> None:
    bench = Bench({"kind": "kill", "start_s": 1.0, "duration_s": 4.0}, kind=ImpairableRobot)
    robot, behind = bench.robot, bench.behind
    bench.look(0.9)
    robot.switch_ac_sc(Controller.AC, "go on")
    goal = robot.goto(Waypoint(1.0, 1.0), Controller.AC)
    links = [bench.look(at_s, x_m=at_s).link for at_s in (1.0, 1.6, 4.95)]
    assert links == [Link.UP, Link.STALE, Link.DOWN]
    behind.calls.clear()
    robot.renew_lease()
    robot.switch_ac_sc(Controller.SC, "no state")
    robot.goto(Waypoint(2.0, 2.0), Controller.SC)
    assert goal.status is GoalStatus.PREEMPTED
    assert behind.calls == []
    state = bench.look(5.0, x_m=5.0)
    assert (state.link, state.x_m) == (Link.UP, 5.0)
    assert behind.calls == ["impair", "hand over SC", "renew", "renew"]


def test_late_commands_die_with_the_robot() -> None:
    bench = Bench(
        {"kind": "delay", "commands_s": 0.3},
        {"kind": "kill", "start_s": 1.0, "duration_s": 0.2},
        kind=ImpairableRobot,
    )
    bench.look(0.9)
    bench.robot.goto(Waypoint(1.0, 1.0), Controller.SC)
    bench.look(1.0)
    bench.look(2.0)
    assert bench.behind.sent == []


def test_goals_keep_their_numbers_and_end_once() -> None:
    bench = Bench({"kind": "duplicate", "commands": 1.0})
    goal = bench.robot.goto(Waypoint(1.0, 1.0), Controller.SC)
    behind = bench.behind.sent[-1]
    assert behind.id != goal.id
    assert bench.look(0.1, goal_id=behind.id).goal_id == goal.id
    assert bench.look(0.15, goal_id=99).goal_id is None
    goal.cancel()
    assert behind.status is GoalStatus.CANCELLED
    assert bench.behind.calls[-1] == "halt"


def test_the_clock_of_the_fleet_is_that_of_the_backend() -> None:
    fleet = fleet_of({"kind": "bias", "x_m": 0.1})
    inner = fleet.inner.clock
    fleet.clock.sleep_until(1.25)
    assert fleet.clock.now() == inner.now() == 1.25
    fleet.clock.sleep_until(1.0)
    assert fleet.clock.now() == 1.25
    assert abs(fleet.clock.steady_s() - inner.steady_s()) < 10.0


def test_closing_closes_what_is_behind_and_drops_what_is_on_its_way() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.3})
    goal = bench.robot.goto(Waypoint(1.0, 1.0), Controller.SC)
    with bench.fleet as fleet:
        assert isinstance(fleet, FaultyFleet)
    bench.fleet.close()
    bench.fleet.clock.sleep_until(5.0)
    assert goal.status is GoalStatus.CANCELLED
    assert bench.behind.sent == []
    assert bench.behind.calls.count("disconnect") == 1
    with pytest.raises(LifecycleError):
        bench.robot.goto(Waypoint(1.0, 1.0), Controller.SC)


def test_faults_start_when_the_robot_is_ready() -> None:
    clock = VirtualClock()
    clock.sleep_until(100.0)
    behind = FakeRobot(RobotSpec(1, 0.0, 0.0, 0.0), clock)
    tables = read_faults(mission({"kind": "bias", "x_m": 1.0, "start_s": 1.0}), [1])
    fleet = FaultyFleet(FakeFleet([behind], clock), tables, 0, 0.05)
    robot = fleet.robots[0]
    clock.sleep_until(110.0)
    robot.init(1.0)
    seen = []
    for at_s in (110.95, 111.0):
        clock.sleep_until(at_s)
        behind.place()
        seen.append(robot.read_state().x_m)
    assert seen == [0.0, 1.0]


def test_the_report_counts_what_each_fault_did() -> None:
    bench = Bench(
        {"kind": "battery", "offset": -0.1, "start_s": 0.5}, {"kind": "delay", "jitter_s": 0.0, "commands_s": 9}
    )
    bench.seen(20)
    bench.robot.goto(Waypoint(1.0, 1.0), Controller.SC)
    battery, delay = bench.fleet.injected()
    assert (battery.kind, battery.robot_id, battery.declared, battery.affected) == ("battery", 1, True, 11)
    assert (delay.kind, delay.affected) == ("delay", 2)
