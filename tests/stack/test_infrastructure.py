"""What of a workspace no safe controller could make up for is refused before anything moves, with the numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.check.admission import declare_all
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import load_backend
from soter.sdk import Capabilities
from soter.stack.infrastructure import occupied
from soter.stack.modules.battery import WAITING
from soter.stack.refuge import RefugeFinder
from soter.stack.terrain import Point, Terrain
from tests.stack.ground import RADIUS_M, dock, planner
from tests.stack.loop import MISSION

PROMISED: Capabilities = load_backend("kinematic").robot_class.declared


def place(robot_id: int, start: Point, station: Point | None = None, half_m: float = 0.2) -> RobotPlace:
    x, y = station or start
    return RobotPlace(robot_id, *start, Box(x - half_m, y - half_m, x + half_m, y + half_m))


def check(
    robots: list[RobotPlace], boxes: tuple[Box, ...] = (), promised: Capabilities = PROMISED, **keys: Any
) -> None:
    mission = load_mission(MISSION, {"backend": "kinematic", **{k.replace("__", "."): v for k, v in keys.items()}})
    workspace = Workspace(5.0, 5.0, boxes, tuple(robots))
    for declared in declare_all(mission, workspace, {robot.id: promised for robot in robots}).values():
        declared.check(mission.base_tick_s)


def refusal(robots: list[RobotPlace], boxes: tuple[Box, ...] = (), **keys: Any) -> str:
    """Return what a workspace is refused with."""
    with pytest.raises(IllFormedModule) as caught:
        check(robots, boxes, **keys)
    assert caught.value.module == "battery"
    assert caught.value.condition == "P2b"
    return str(caught.value)


def suggested(message: str) -> float:
    """Return the last length that a message names."""
    return float(re.findall(r"(\d+\.\d+) m", message)[-1])


OPEN = (2.5, 2.5)


def test_a_room_without_anything_is_accepted() -> None:
    check([place(1, (1.0, 1.0)), place(2, OPEN)])


def test_a_station_too_near_to_the_fence_is_refused() -> None:
    message = refusal([place(1, OPEN, (2.5, 0.01))])
    assert "charging station of robot 1 at (2.5, 0.01) is 0.010 m from the fence" in message
    check([place(1, OPEN, (2.5, suggested(message) + 1e-6))])


def test_a_station_too_near_to_a_box_is_refused() -> None:
    box = Box(2.0, 0.0, 3.0, 1.0)
    message = refusal([place(1, (1.0, 1.0), (2.5, 1.15))], (box,))
    assert "charging station of robot 1 at (2.5, 1.15) is 0.045 m from a box" in message
    check([place(1, (1.0, 1.0), (2.5, 1.0 + PROMISED.body_radius_m + suggested(message)))], (box,))


def test_rules_that_are_off_ask_nothing_of_a_station() -> None:
    # It may be at the very fence, or in a box, where no module keeps the robot from there.
    check([place(1, OPEN, (2.5, 0.01))], rta__modules=["obstacle", "battery"])
    check([place(1, (1.0, 1.0), (2.5, 1.15))], (Box(2.0, 0.0, 3.0, 1.0),), rta__modules=["geofence", "battery"])
    check([place(1, OPEN), place(2, (1.0, 1.0), (2.6, 2.5))], rta__modules=["geofence", "battery"])
    check([place(1, OPEN, (2.5, 0.01))], rta__modules=["obstacle", "geofence"])


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_a_station_too_small_for_the_noise_is_refused(noise_m: float) -> None:
    promised = replace(PROMISED, position_noise_m=noise_m)
    least_m = 2.0 * (0.03 + noise_m)
    keys: dict[str, Any] = {"promised": promised, "rta__modules": ["battery"]}
    message = refusal([place(1, (1.0, 1.0), OPEN, least_m / 2.0 - 0.001)], **keys)
    assert f"charging station of robot 1 at (2.5, 2.5) is {least_m - 0.002:.3f} m wide" in message
    assert f"wrong by up to {noise_m:g} m" in message
    assert suggested(message) == pytest.approx(least_m)
    check([place(1, (1.0, 1.0), OPEN, suggested(message) / 2.0 + 1e-9)], **keys)


def test_stations_too_near_to_each_other_are_refused() -> None:
    message = refusal([place(1, (1.0, 1.0), OPEN), place(2, (4.0, 4.0), (2.8, 2.5))])
    assert "charging stations of robots 1 and 2 are 0.300 m apart" in message
    needed_m = float(re.findall(r"needs (\d+\.\d+) m from a robot on the other", message)[0])
    check([place(1, (1.0, 1.0), OPEN), place(2, (4.0, 4.0), (2.5 + needed_m + 1e-3, 2.5))])


def test_a_station_behind_another_one_is_refused() -> None:
    """In a passage one robot that charges would keep the other from its station for ever."""
    passage = (Box(2.0, 0.0, 4.0, 2.1), Box(2.0, 2.9, 4.0, 5.0))
    robots = [place(1, (4.5, 2.5), (1.0, 2.5)), place(2, (4.5, 1.0), (3.0, 2.5))]
    message = refusal(robots, passage)
    assert "no path for robot 1 from its start at (4.5, 2.5) to its charging station at (1, 2.5)" in message
    assert "from the stations of the other robots" in message
    check([robots[0]], passage)
    check(robots, (Box(2.0, 0.0, 4.0, 1.9), Box(2.0, 3.9, 4.0, 5.0)))


def test_a_station_behind_a_wall_is_refused_with_the_gap_that_would_do() -> None:
    robot = place(1, (4.0, 2.5), (1.0, 2.5))

    def wall(gap_m: float) -> tuple[Box, Box]:
        return Box(2.0, 0.0, 2.2, 2.5), Box(2.0, 2.5 + gap_m, 2.2, 5.0)

    message = refusal([robot], wall(0.32))
    assert "no path for robot 1 from its start at (4, 2.5) to its charging station at (1, 2.5)" in message
    assert "from boxes and fence" in message
    assert message == refusal([robot], wall(0.0))
    gaps = re.search(r"gaps of (\d+\.\d+) m", message)
    assert gaps is not None
    check([robot], wall(float(gaps[1]) + 1e-5))


def test_a_station_from_which_no_refuge_can_be_reached_is_refused() -> None:
    """The robot would charge, and never be given back."""
    # A corridor that a robot can drive along, but nowhere in which geofence and obstacle let go.
    closed = (Box(0.0, 0.35, 5.0, 0.9),)
    message = refusal([place(1, (4.0, 0.175), (1.0, 0.175))], closed)
    assert "from the charging station of robot 1 at (1, 0.175) no place can be reached" in message
    assert "phi_safer" in message
    check([place(1, (4.0, 0.175), (1.0, 0.175))], (Box(0.0, 0.35, 4.0, 0.9),))


def test_a_refuge_that_occupied_stations_leave_no_room_in_is_refused() -> None:
    """Two robots that charge would keep each other from the only place where the geofence lets go."""
    robots = [place(1, (2.2, 2.5)), place(2, (2.8, 2.5))]
    message = refusal(robots, rta__geofence__phi_safer_inset_m=2.4)
    assert "from the stations of the other robots" in message
    assert "phi_safer_inset_m" in message
    check(robots[:1], rta__geofence__phi_safer_inset_m=2.4)
    check([place(1, (1.8, 2.5)), place(2, (3.2, 2.5))], rta__geofence__phi_safer_inset_m=2.4)


@pytest.mark.parametrize(("door_m", "both"), [(0.0, False), (0.2, False), (1.0, True)])
def test_places_that_no_path_leads_to_are_no_room_to_get_past_each_other(door_m: float, both: bool) -> None:
    low_m, high_m = 2.5 - 0.5 * door_m, 2.5 + 0.5 * door_m
    wall = (Box(0.0, 2.4, low_m, 2.6), Box(high_m, 2.4, 5.0, 2.6))
    terrain = Terrain(Workspace(5.0, 5.0, wall, ()), RADIUS_M)
    recovery = planner(terrain)
    refuges = RefugeFinder(terrain, recovery, 0.25, 0.15)
    path = dock(recovery, Box(0.8, 0.8, 1.2, 1.2)).path
    everywhere = refuges.room_for(50, 1.0, lambda *_: True)
    assert refuges.room_for(50, 1.0, path.leads_back) == (everywhere if both else everywhere // 2)


@given(
    st.floats(0.0, math.tau), st.floats(1.0, 1.5), st.floats(0.2, 3.0), st.floats(0.0, math.tau), st.floats(0.0, 1.0)
)
def test_the_room_of_a_robot_on_its_station_is_kept_free_and_the_own_station_is_outside(
    bearing_rad: float, share: float, apart_m: float, angle_rad: float, inside: float
) -> None:
    station, far_m = (3.0, -2.0), share * apart_m * (1.0 + 1e-9)
    own = station[0] + far_m * math.cos(bearing_rad), station[1] + far_m * math.sin(bearing_rad)
    rectangles = occupied(station, apart_m, own)
    r_m = inside * apart_m * (1.0 - 1e-9)
    x, y = station[0] + r_m * math.cos(angle_rad), station[1] + r_m * math.sin(angle_rad)
    assert any(low_x <= x <= high_x and low_y <= y <= high_y for low_x, low_y, high_x, high_y in rectangles)
    assert not any(low_x < own[0] < high_x and low_y < own[1] < high_y for low_x, low_y, high_x, high_y in rectangles)


def test_a_station_in_the_corner_of_the_square_around_another_one_is_reached() -> None:
    mission = load_mission(MISSION, {"backend": "kinematic"})
    off_m = 0.8 * planner().apart_m(PROMISED.sample_age_s)
    robots = (place(1, OPEN), place(2, (OPEN[0] + off_m, OPEN[1] + off_m)))
    made = declare_all(mission, Workspace(5.0, 5.0, (), robots), {1: PROMISED, 2: PROMISED})
    assert off_m < made[1].recovery.apart_m(PROMISED.sample_age_s) < math.sqrt(2.0) * off_m
    for declared, side in ((made[1], -1.0), (made[2], 1.0)):
        x, y = declared.place.charger.centre
        for beside in ((x + side * 0.3, y), (x, y + side * 0.3)):
            assert declared.dock.path.shortest_m(*beside) < 1.0


@pytest.mark.parametrize(("door_m", "shut_in"), [(0.8, 1), (2.2, 0)])
def test_a_station_in_a_door_shuts_robots_in_and_one_beside_a_path_does_not(door_m: float, shut_in: int) -> None:
    walls = Box(2.4, 0.0, 2.6, 2.5 - door_m / 2.0), Box(2.4, 2.5 + door_m / 2.0, 2.6, 5.0)
    robots = place(1, (1.0, 2.5)), place(2, (1.0, 4.0), OPEN)
    missions = [load_mission(MISSION, {"backend": "kinematic", "battery.charge_s": each}) for each in (200.0, 300.0)]
    fast, slow = (
        declare_all(each, Workspace(5.0, 5.0, walls, robots), dict.fromkeys((1, 2), PROMISED)) for each in missions
    )
    battery, phi_safer = missions[0].battery, missions[0].rta.battery.phi_safer
    waits = WAITING * phi_safer * 100.0 / min(battery.idle_s, WAITING * battery.drive_s)
    # Who has the station in the door is shut in by none.
    more = [slow[each].module("battery").keep - fast[each].module("battery").keep for each in (1, 2)]
    assert more == pytest.approx([shut_in * waits, 0.0])


corner = st.floats(0.0, 4.4)


@given(
    st.lists(st.tuples(corner, corner, st.floats(0.3, 1.5), st.floats(0.3, 1.5)), min_size=1, max_size=4),
    st.lists(st.tuples(corner, corner, st.floats(0.05, 1.0), st.floats(0.05, 1.0)), max_size=3),
)
def test_all_places_around_a_station_in_the_open_see_the_next_one(
    stations: list[tuple[float, float, float, float]], boxes: list[tuple[float, float, float, float]]
) -> None:
    terrain = Terrain(Workspace(5.0, 5.0, tuple(Box(x, y, x + w, y + h) for x, y, w, h in boxes), ()), RADIUS_M)
    rooms = [(x, y, x + w, y + h) for x, y, w, h in stations]
    path = dock(planner(terrain), Box(4.6, 4.6, 4.9, 4.9), rooms).path
    for room in rooms:
        if path.open_around([room]):
            low_x, low_y, high_x, high_y = (room[0] - 1e-6, room[1] - 1e-6, room[2] + 1e-6, room[3] + 1e-6)
            around = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y), (low_x, low_y)]
            for one, other in pairwise(around):
                assert path.fits(*one)
                assert path.sees(one, other)
