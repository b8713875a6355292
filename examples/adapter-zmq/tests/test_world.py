from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter_zmq.drive import OVERSHOOT_M, TUBE_M, drive
from soter_zmq.wire import BODY_RADIUS_M, BRAKE_M_S2, PERIOD_S, V_MAX_M_S, GoalMessage, compass_deg
from soter_zmq.world import Body, Rectangle, World


def body(robot_id: int = 1, x_m: float = 2.0, y_m: float = 2.0, heading_rad: float = 0.0, charge: float = 1.0) -> Body:
    return Body(robot_id, x_m, y_m, heading_rad, charge, 1800.0, 7200.0, 60.0)


def world(*bodies: Body, boxes: tuple[Rectangle, ...] = (), chargers: tuple[Rectangle, ...] = ()) -> World:
    return World(6.0, 5.0, boxes, chargers, bodies)


def run(room: World, seconds: float, goal: GoalMessage | None = None) -> None:
    for _ in range(round(seconds / PERIOD_S)):
        for each in room.bodies:
            each.wanted = drive(each.x_m, each.y_m, each.heading_rad, each.v_m_s, each.yaw_rate_rad_s, goal)
        room.step()


def goal_at(x_m: float, y_m: float, heading_rad: float | None = None, speed_m_s: float | None = None) -> GoalMessage:
    return GoalMessage(1, "SC", y_m, x_m, None if heading_rad is None else compass_deg(heading_rad), speed_m_s)


coordinates = st.tuples(st.floats(0.0, 4.0), st.floats(0.0, 4.0))
headings = st.one_of(st.none(), st.floats(-math.pi, math.pi))


@given(coordinates, st.floats(-math.pi, math.pi), headings)
def test_a_leg_stays_in_its_tube_and_ends_at_its_place(
    place: tuple[float, float], heading_rad: float, wanted_rad: float | None
) -> None:
    robot = body(heading_rad=heading_rad)
    room = world(robot)
    goal = goal_at(*place, wanted_rad)
    distance_m = math.dist((2.0, 2.0), place)
    for _ in range(round((distance_m / V_MAX_M_S + 8.0) / PERIOD_S)):
        run(room, PERIOD_S, goal)
        along_m, off_m = from_leg(robot, place)
        assert off_m <= TUBE_M
        assert along_m <= distance_m + OVERSHOOT_M
    assert math.dist((robot.x_m, robot.y_m), place) <= 0.01
    assert robot.v_m_s == 0.0
    if wanted_rad is not None:
        assert abs(math.remainder(robot.heading_rad - wanted_rad, 2 * math.pi)) <= 0.05


def from_leg(robot: Body, place: tuple[float, float]) -> tuple[float, float]:
    """How far along the leg from (2, 2) a robot is, and how far beside it."""
    dx, dy = place[0] - 2.0, place[1] - 2.0
    length = math.hypot(dx, dy)
    rx, ry = robot.x_m - 2.0, robot.y_m - 2.0
    if length < 1e-6:
        return math.hypot(rx, ry), 0.0
    return (rx * dx + ry * dy) / length, abs(rx * dy - ry * dx) / length


@given(st.lists(coordinates, min_size=2, max_size=4), st.floats(0.1, 2.0))
def test_whatever_the_goals_no_body_is_faster_than_declared(places: list[tuple[float, float]], each_s: float) -> None:
    robot = body()
    room = world(robot)
    for place in places:
        goal = goal_at(*place)
        for _ in range(round(each_s / PERIOD_S)):
            before, speed = (robot.x_m, robot.y_m), abs(robot.v_m_s)
            run(room, PERIOD_S, goal)
            assert math.dist(before, (robot.x_m, robot.y_m)) <= V_MAX_M_S * PERIOD_S + 1e-12
            assert speed - abs(robot.v_m_s) <= BRAKE_M_S2 * PERIOD_S + 1e-12


def test_a_robot_that_is_told_nothing_brakes() -> None:
    robot = body()
    room = world(robot)
    run(room, 2.0, goal_at(5.0, 2.0))
    assert robot.v_m_s == pytest.approx(V_MAX_M_S)
    x_m = robot.x_m
    run(room, 1.0)
    assert robot.v_m_s == 0.0
    assert robot.x_m - x_m <= V_MAX_M_S**2 / (2 * BRAKE_M_S2) + 1e-9


def test_a_cap_on_the_speed_is_kept() -> None:
    robot = body()
    room = world(robot)
    run(room, 2.0, goal_at(5.0, 2.0, speed_m_s=0.05))
    assert robot.v_m_s == pytest.approx(0.05)


def test_a_place_behind_is_reached_backwards() -> None:
    robot = body()
    room = world(robot)
    run(room, 1.0, goal_at(1.0, 2.0, 0.0))
    assert robot.v_m_s < 0.0
    assert robot.heading_rad == pytest.approx(0.0, abs=0.05)


def test_motors_do_no_more_than_they_can() -> None:
    robot = body()
    room = world(robot)
    for _ in range(100):
        robot.wanted = (10.0, 0.0)
        room.step()
    assert robot.v_m_s == pytest.approx(V_MAX_M_S)


def test_a_box_stops_a_body_and_breaks_a_rule_once() -> None:
    robot = body()
    room = world(robot, boxes=((3.0, 1.0, 4.0, 3.0),))
    run(room, 10.0, goal_at(5.0, 2.0))
    assert 3.0 - BODY_RADIUS_M - 0.01 < robot.x_m <= 3.0 - BODY_RADIUS_M
    assert [each[0] for each in room.violations] == ["obstacle"]
    assert room.violations[0][3] is None
    assert room.contacts == 1
    assert room.min_margin["obstacle"] >= 0.0


def test_two_bodies_meet_and_part() -> None:
    moving, standing = body(1), body(2, 3.0)
    room = world(moving, standing)
    for _ in range(round(6.0 / PERIOD_S)):
        moving.wanted = (V_MAX_M_S, 0.0)
        room.step()
    assert room.contacts == 1
    assert [each[:2] for each in room.violations] == [("collision", (1, 2))]
    for _ in range(round(3.0 / PERIOD_S)):
        moving.wanted = (-V_MAX_M_S, 0.0)
        room.step()
    rule, robots, begin_s, end_s = room.violations[0]
    assert (rule, robots) == ("collision", (1, 2))
    assert end_s is not None
    assert 0.0 < begin_s < end_s < room.now_s


def test_the_fence_is_a_line_on_the_ground() -> None:
    robot = body()
    room = world(robot)
    run(room, 13.0, goal_at(2.0, -0.2))
    assert robot.y_m == pytest.approx(-0.2, abs=0.01)
    assert [each[0] for each in room.violations] == ["geofence"]


def test_what_is_broken_at_the_start_counts() -> None:
    room = world(body(1, -1.0), body(2, -1.1), boxes=((-1.0, 1.9, 0.0, 2.1),))
    assert {each[0] for each in room.violations} == {"geofence", "collision", "obstacle"}
    assert all(each[2] == 0.0 for each in room.violations)


def test_driving_costs_charge_and_a_flat_robot_stays_where_it_is() -> None:
    robot = body(charge=2.0 / 1800.0)
    room = world(robot)
    run(room, 10.0, goal_at(5.0, 2.0))
    assert (robot.charge, robot.v_m_s) == (0.0, 0.0)
    assert [each[0] for each in room.violations] == ["battery"]


def test_at_rest_on_its_patch_a_robot_charges() -> None:
    robot = body(charge=0.5)
    room = world(robot, chargers=((1.9, 1.9, 2.1, 2.1),))
    run(room, 6.0)
    assert robot.charge == pytest.approx(0.6)
    run(room, 60.0)
    assert robot.charge == 1.0


def test_a_world_is_read_from_plain_numbers() -> None:
    values = {"width_m": 6, "depth_m": 5, "boxes": [[3, 1, 4, 3]], "chargers": [[1, 1, 2, 2]],
              "robots": [{"id": 4, "x_m": 2.0, "y_m": 2.0, "heading_rad": 0.0, "charge": 1.0, "drive_s": 1.0,
                          "idle_s": 1.0, "charge_s": 1.0}]}  # fmt: skip
    room = World.read(values)
    assert room.bodies[0].id == 4
    assert room.clearance_m(2.0, 2.0) == pytest.approx(1.0 - BODY_RADIUS_M)
