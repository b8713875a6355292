"""The robots of the backends `pybullet` and `kinematic`, through the narrow interface."""

from __future__ import annotations

import math
import random
import re
import sys
from collections.abc import Iterator

import pytest
from pydantic import ValidationError

from soter.adapters.pybullet import KinematicBackend, KinematicConfig, PyBulletBackend, PyBulletConfig, SimulatedFleet
from soter.errors import BackendUnavailable, LifecycleError, RobotUnavailable
from soter.hints import install_command
from soter.sdk import INTERFACE_VERSION, Controller, GoalStatus, Link, Robot, RobotSpec, Waypoint
from soter.stack.reach import MotionLimits
from soter_sim.kinematic import KinematicEngine
from tests.sim.worlds import CASE, empty, from_segment

AC, SC = Controller.AC, Controller.SC
TICK_S = 0.05
ENGINES = [pytest.param("kinematic"), pytest.param("pybullet", marks=pytest.mark.pybullet)]


def open_fleet(engine: str, *specs: RobotSpec) -> SimulatedFleet:
    workspace = empty(5.0, 5.0)
    if engine == "kinematic":
        return KinematicBackend().open(KinematicConfig(workspace=workspace), specs)
    return PyBulletBackend().open(PyBulletConfig(workspace=workspace), specs)


@pytest.fixture(params=ENGINES)
def fleet(request: pytest.FixtureRequest) -> Iterator[SimulatedFleet]:
    """Two robots, ready, far from each other."""
    with open_fleet(request.param, RobotSpec(1, 1.0, 1.0, 0.0), RobotSpec(2, 4.0, 4.0, 1.0, battery=0.5)) as fleet:
        for robot in fleet.robots:
            robot.init(1.0)
        yield fleet


def tick(fleet: SimulatedFleet, times: int = 1, *, renew: bool = True) -> None:
    """Run whole ticks, as the supervisor does: read, renew, sleep."""
    for _ in range(times):
        for robot in fleet.robots:
            robot.read_state()
            if renew:
                robot.renew_lease()
        fleet.clock.sleep_until(fleet.clock.now() + TICK_S)


def place(fleet: SimulatedFleet, robot_id: int) -> tuple[float, float]:
    assert fleet.truth is not None
    x, y, _ = fleet.truth.pose(robot_id)
    return x, y


def speed(robot: Robot) -> float:
    state = robot.read_state()
    return math.hypot(state.vx_m_s, state.vy_m_s)


def test_the_first_sample_is_where_the_specs_say(fleet: SimulatedFleet) -> None:
    state = fleet.robots[1].read_state()
    assert (state.robot_id, state.x_m, state.y_m, state.z_m, state.heading_rad) == (2, 4.0, 4.0, 0.0, 1.0)
    assert (state.battery, state.controller, state.goal_id, state.link) == (0.5, SC, None, Link.UP)
    assert (state.stamp_s, state.vehicle_stamp_s) == (0.0, 0.0)


def test_a_goal_is_driven_to_and_reached(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    goal = robot.goto(Waypoint(1.5, 1.2), SC)
    while goal.active:
        tick(fleet)
    assert goal.status is GoalStatus.REACHED
    assert math.dist(place(fleet, 1), (1.5, 1.2)) <= 0.1
    tick(fleet, 30)
    assert math.dist(place(fleet, 1), (1.5, 1.2)) <= 0.01
    assert place(fleet, 2) == pytest.approx((4.0, 4.0), abs=1e-3)


def test_samples_at_whole_ticks_are_never_old(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    robot.goto(Waypoint(2.0, 1.0), SC)
    for _ in range(200):
        tick(fleet)
        assert robot.read_state().age_s(fleet.clock.now()) == 0.0
    before = robot.read_state()
    fleet.clock.sleep_until(fleet.clock.now() + 0.02)
    assert robot.read_state().age_s(fleet.clock.now()) == pytest.approx(0.02)
    assert robot.read_state().stamp_s == pytest.approx(before.stamp_s)


def test_the_same_object_is_returned_while_nothing_changes(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    first = robot.read_state()
    assert robot.read_state() is first
    goal = robot.goto(Waypoint(2.0, 1.0), SC)
    assert robot.read_state().goal_id == goal.id
    tick(fleet)
    assert robot.read_state().stamp_s > first.stamp_s


def test_the_wrong_controllers_goal_moves_nothing(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    assert robot.goto(Waypoint(2.0, 1.0), AC).status is GoalStatus.REJECTED
    tick(fleet, 20)
    assert place(fleet, 1) == pytest.approx((1.0, 1.0), abs=1e-4)


def test_a_switch_flushes_what_the_other_had_in_flight(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    robot.switch_ac_sc(AC, "test")
    goal = robot.goto(Waypoint(3.0, 1.0), AC)
    tick(fleet, 20)
    assert speed(robot) > 0.2
    here = place(fleet, 1)
    switch = robot.switch_ac_sc(SC, "test")
    assert goal.status is GoalStatus.PREEMPTED
    assert (switch.effective_s, switch.confirmed_s) == (fleet.clock.now(), None)
    assert robot.read_state().controller is SC
    assert switch.confirmed_s == fleet.clock.now()
    tick(fleet, 20)
    assert math.dist(place(fleet, 1), here) <= 0.22**2 / 2 + 1e-9
    assert robot.read_state().goal_id is None
    # Given back, it does not go on by itself.
    robot.switch_ac_sc(AC, "test")
    tick(fleet, 10)
    assert speed(robot) < 1e-3


def test_without_renewal_the_vehicle_stops_by_itself(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    robot.goto(Waypoint(3.0, 1.0), SC)
    tick(fleet, 40)
    here, lease_s = place(fleet, 1), robot.capabilities.lease_s
    tick(fleet, 20, renew=False)
    assert speed(robot) < 1e-3
    gone = math.dist(place(fleet, 1), here)
    assert 0.05 * 0.22 < gone <= 0.22 * lease_s + 0.22**2 / 2 + 1e-9
    tick(fleet, 20)
    assert speed(robot) > 0.2


def test_nothing_moves_before_the_lease_is_renewed_for_the_first_time(fleet: SimulatedFleet) -> None:
    fleet.robots[0].goto(Waypoint(3.0, 1.0), SC)
    tick(fleet, 20, renew=False)
    assert place(fleet, 1) == pytest.approx((1.0, 1.0), abs=1e-4)


def test_a_cancelled_and_a_late_goal_stop_the_robot(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    for target in (Waypoint(3.0, 1.0), Waypoint(3.0, 1.0, timeout_s=1.0)):
        goal = robot.goto(target, SC)
        tick(fleet, 19)
        assert speed(robot) > 0.2
        if target.timeout_s > 1.0:
            goal.cancel()
        tick(fleet, 15)
        assert goal.status in {GoalStatus.CANCELLED, GoalStatus.TIMED_OUT}
        assert speed(robot) < 1e-3
        assert robot.read_state().goal_id is None


def test_the_robot_stays_in_the_declared_tube_backwards_too(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    promised = robot.capabilities
    for end, heading in (((1.6, 1.4), None), ((1.0, 1.0), 0.58)):
        start = place(fleet, 1)
        goal = robot.goto(Waypoint(*end, heading_rad=heading, radius_m=0.011), SC)
        for _ in range(150):
            tick(fleet)
            off, over = from_segment(*place(fleet, 1), start, end)
            assert off <= promised.tube_m
            assert over <= promised.overshoot_m
        assert goal.status is GoalStatus.REACHED


def test_wherever_they_are_sent_robots_move_as_the_unicycle_that_they_promise_to_be(fleet: SimulatedFleet) -> None:
    draw = random.Random(5)
    robot = fleet.robots[0]
    promised = robot.declared
    model = MotionLimits.of(promised).motion("geofence", "unicycle")
    assert promised.speed_noise_m_s is not None
    before = robot.read_state()
    for n in range(600):
        if n % 12 == 0:
            robot.goto(Waypoint(draw.uniform(0.5, 2.0), draw.uniform(0.5, 2.0)), SC)
        tick(fleet)
        after = robot.read_state()
        aside_m_s = after.vy_m_s * math.cos(after.heading_rad) - after.vx_m_s * math.sin(after.heading_rad)
        assert abs(aside_m_s) <= promised.speed_noise_m_s + 1e-9
        assert model.admits(before, after, promised.position_noise_m)
        before = after


def test_closing_leaves_every_robot_at_rest(fleet: SimulatedFleet) -> None:
    for robot in fleet.robots:
        robot.goto(Waypoint(2.5, 2.5), SC)
    tick(fleet, 60)
    before = fleet.clock.now()
    fleet.close()
    fleet.close()
    bodies = fleet.world.bodies
    assert all(abs(v) <= 1e-3 for v in bodies.v)
    assert fleet.clock.now() - before < 1.0
    with pytest.raises(LifecycleError):
        fleet.robots[0].read_state()


def test_a_robot_that_was_never_ready_can_be_closed() -> None:
    fleet = open_fleet("kinematic", RobotSpec(1, 1.0, 1.0, 0.0))
    fleet.close()
    assert fleet.clock.now() == 0.0


def test_a_robot_may_be_closed_after_its_fleet() -> None:
    fleet = open_fleet("kinematic", RobotSpec(1, 1.0, 1.0, 0.0))
    fleet._close()
    fleet.robots[0].close(1.0)


def test_robots_promise_no_more_than_their_class(fleet: SimulatedFleet) -> None:
    robot = fleet.robots[0]
    assert robot.capabilities.widened_beyond(type(robot).declared) is None
    assert PyBulletBackend.interface_version == INTERFACE_VERSION
    backend = KinematicBackend if isinstance(fleet.world.engine, KinematicEngine) else PyBulletBackend
    assert type(robot) is backend.robot_class
    assert KinematicBackend.robot_class.declared.widened_beyond(PyBulletBackend.robot_class.declared) is None


def test_robots_that_cannot_be_there_are_refused() -> None:
    with pytest.raises(RobotUnavailable, match="each number once"):
        open_fleet("kinematic", RobotSpec(1, 1.0, 1.0, 0.0), RobotSpec(1, 2.0, 1.0, 0.0))


def test_the_engine_is_an_option_of_one_backend_only() -> None:
    with PyBulletBackend().open(PyBulletConfig(workspace=CASE, engine="kinematic"), [RobotSpec(1, 1, 1, 0)]) as fleet:
        assert type(fleet.world.engine).__name__ == "KinematicEngine"
    with pytest.raises(ValidationError):
        PyBulletConfig.model_validate({"workspace": CASE, "engine": "gazebo"})
    with pytest.raises(ValidationError):
        KinematicConfig.model_validate({"workspace": CASE, "engine": "pybullet"})


def test_a_missing_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "soter_sim.pybullet", raising=False)
    with pytest.raises(BackendUnavailable, match=re.escape(install_command("pybullet"))):
        open_fleet("pybullet", RobotSpec(1, 1.0, 1.0, 0.0))


@pytest.mark.parametrize("engine", ENGINES)
def test_two_fleets_with_the_same_calls_give_the_same_samples(engine: str) -> None:
    def samples() -> list[object]:
        found: list[object] = []
        with open_fleet(engine, RobotSpec(1, 1.0, 1.0, 0.0)) as fleet:
            fleet.robots[0].init(1.0)
            fleet.robots[0].goto(Waypoint(1.6, 1.7), SC)
            for _ in range(100):
                tick(fleet)
                found.append(fleet.robots[0].read_state())
        return found

    assert samples() == samples()
