"""Robots on their way to charge are left their path by all others, parked ones included, one after the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.rta import RobotSupervisor
from soter.sdk import Controller
from soter.stack.collision import FIRST_PATIENT_S
from soter.stack.kit import RobotPort
from soter.stack.retreat import ASIDE_S, PATIENT_S
from soter.stack.right_of_way import BESIDE_M, LOOK_S, SETTLED_S, TURN_S, Path, RightOfWay, from_line
from soter.stack.terrain import Point, Terrain
from tests.rta.doubles import At
from tests.stack.follower import Controllers, Follower, Says
from tests.stack.ground import EMPTY, seen
from tests.stack.loop import Loop, goto, where
from tests.stack.test_right_of_way import Meeting

APART_M = 0.5
NOW_S = 100.0


class Homing(Meeting):
    """Some robots with stations; those that the test says are on their way there, straight."""

    def __init__(self, places: Sequence[Point], stations: Sequence[Point], ahead_m: float = math.inf) -> None:
        self.stations = dict(enumerate(stations, start=1))
        super().__init__(
            *places,
            rule=RightOfWay(
                apart_m=lambda _: APART_M,
                legs=lambda robot_id, x_m, y_m: [self.stations[robot_id]],
                docked=self.docked,
                ahead_m=lambda _: ahead_m,
            ),
        )

    def docked(self, robot: RobotSupervisor) -> bool:
        own = robot.situation.own
        return math.dist((own.x_m, own.y_m), self.stations[robot.robot_id]) < 0.2

    def home(self, *numbers: int, now_s: float = NOW_S) -> None:
        """Have the battery's module send robots home, in this order."""
        for number in numbers:
            self.mode(number, "battery", Controller.SC, now_s)
            self.look(now_s + SETTLED_S + 0.05)

    def leaving(self) -> dict[int, Path]:
        found = {number: self.rule.path_to_leave(number) for number in self.robots}
        return {number: path for number, path in found.items() if path is not None}

    def collision(self, number: int) -> Controller:
        return self.rigs[number].modules["collision"].mode


def parked() -> Homing:
    """Robot 1 stands on the station of robot 2."""
    return Homing([(3.0, 0.0), (0.0, 0.0)], [(0.0, 3.0), (3.0, 0.0)])


def test_a_robot_that_is_parked_on_anothers_station_is_moved() -> None:
    meeting = parked()
    meeting.mode(2, "battery", Controller.SC, NOW_S)
    meeting.look(NOW_S + SETTLED_S)
    assert not meeting.leaving(), "all robots begin with all modules in SC"
    meeting.look(NOW_S + SETTLED_S + 0.05)
    assert meeting.collision(1) is Controller.SC
    assert "robot 2 has to get past" in meeting.rigs[1].modules["collision"].cause
    assert meeting.leaving() == {1: Path(2, (((0.0, 0.0), (3.0, 0.0)),), APART_M, ((3.0, 0.0),))}
    assert not meeting.rule.first(1)
    assert not meeting.permits(1)
    assert not meeting.rule.path_is_clear(2)
    assert meeting.collision(2) is Controller.AC


def test_it_may_go_on_when_it_has_left_the_path_by_more_than_it_must_or_the_other_is_home() -> None:
    meeting = parked()
    meeting.home(2)
    for y_m, leaving in ((APART_M + 0.01, True), (APART_M + BESIDE_M - 0.01, True), (APART_M + BESIDE_M + 0.01, False)):
        meeting.put(1, (1.5, y_m))
        meeting.look(NOW_S + 2.0)
        assert (1 in meeting.leaving()) is leaving
        assert meeting.permits(1) is not leaving
    meeting.put(1, (1.5, APART_M + 0.01))
    meeting.look(NOW_S + 2.0)
    assert not meeting.leaving(), "outside the path it need not leave it"
    meeting.put(1, (2.5, 0.4))
    meeting.look(NOW_S + 2.0)
    assert meeting.leaving()
    meeting.put(2, (3.0, 0.0))
    meeting.look(NOW_S + 3.0)
    assert not meeting.leaving()
    assert meeting.rule.path_is_clear(2)


def test_who_stands_far_along_the_path_has_time() -> None:
    """It keeps its AC until the other is as near along its path as others leave it."""
    meeting = Homing([(8.0, 0.0), (0.0, 0.0)], [(0.0, 9.0), (10.0, 0.0)], ahead_m=3.0)
    meeting.home(2)
    assert not meeting.leaving()
    assert meeting.collision(1) is Controller.AC
    meeting.put(2, (4.0, 0.0))
    meeting.look(NOW_S + 2.0)
    assert not meeting.leaving()
    meeting.put(2, (5.0, 0.0))
    meeting.look(NOW_S + 3.0)
    assert meeting.leaving() == {1: Path(2, (((5.0, 0.0), (8.0, 0.0)),), APART_M, ((10.0, 0.0),))}
    assert meeting.collision(1) is Controller.SC
    meeting.put(2, (8.5, 0.0))
    meeting.put(1, (9.9, 0.0))
    meeting.look(NOW_S + 4.0)
    assert meeting.leaving() == {1: Path(2, (((8.5, 0.0), (10.0, 0.0)),), APART_M, ((10.0, 0.0),))}


@pytest.mark.parametrize(("docked", "mode", "left_alone"), [
    (True, Controller.SC, True), (True, Controller.AC, False), (False, Controller.AC, False),
])  # fmt: skip
def test_a_robot_that_charges_is_left_alone(docked: bool, mode: Controller, left_alone: bool) -> None:
    """It would not get its charge elsewhere; one that just stands on its station would."""
    meeting = Homing([(1.5, 0.0), (0.0, 0.0)], [(1.5, 0.0) if docked else (9.0, 9.0), (3.0, 0.0)])
    meeting.mode(1, "battery", mode, NOW_S - 10.0)
    meeting.home(2)
    assert (1 in meeting.leaving()) is not left_alone
    assert meeting.collision(1) is (Controller.AC if left_alone else Controller.SC)


def crossing() -> Homing:
    """The paths of robots 1 and 2 cross where robot 3 stands; 4 is elsewhere."""
    return Homing(
        [(-2.0, 0.0), (0.0, -2.0), (0.1, 0.1), (9.0, 9.0)], [(2.0, 0.0), (0.0, 2.0), (5.0, 5.0), (9.0, 8.0)]
    )  # fmt: skip


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_who_began_first_goes_first_and_the_others_leave_the_paths_of_all_before_them(order: tuple[int, int]) -> None:
    first, second = order
    meeting = crossing()
    meeting.home(first)
    meeting.home(second, now_s=NOW_S + 1.0)
    assert set(meeting.leaving()) == {3}
    assert [line[-1] for line in meeting.leaving()[3].lines] == [meeting.stations[first], meeting.stations[second]]
    assert meeting.leaving()[3].robot_id == first
    # The second comes to the path of the first, and has to leave it; the other way round it need not.
    meeting.put(second, (0.1, 0.1))
    meeting.look(NOW_S + 5.0)
    assert meeting.leaving()[second].robot_id == first
    assert first not in meeting.leaving()
    assert meeting.collision(first) is Controller.AC
    meeting.put(first, meeting.stations[first])
    meeting.look(NOW_S + 6.0)
    assert second not in meeting.leaving(), "the first is home: now it is the second's turn"
    assert meeting.leaving()[3].robot_id == second


@pytest.mark.parametrize("gets_along", [False, True])
def test_a_first_that_does_not_get_along_goes_to_the_end_of_the_order(gets_along: bool) -> None:
    meeting = crossing()
    meeting.home(1)
    meeting.home(2, now_s=NOW_S + 1.0)
    meeting.put(2, (0.0, -0.3))
    firsts = []
    for step in range(round(2.0 * TURN_S / LOOK_S)):
        now_s = NOW_S + 3.0 + step * LOOK_S
        if gets_along:
            meeting.put(1, (-2.0 + 0.02 * step, 0.0))
        meeting.look(now_s)
        firsts.append(meeting.leaving()[3].robot_id)
    assert firsts[0] == 1
    if gets_along:
        assert set(firsts) == {1}
    else:
        assert 2 in firsts
        turned = firsts.index(2) * LOOK_S
        assert TURN_S - 3.0 <= turned <= TURN_S + 1.0
        assert 2 not in meeting.leaving() or firsts[-1] == 1


places = st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(0.0, 3.0)), min_size=2, max_size=6)


@settings(max_examples=60)
@given(places, places, st.permutations(range(1, 7)), st.integers(0, 6), st.sets(st.integers(1, 6)))
def test_of_two_robots_one_goes_before_the_other_and_the_first_before_all(
    at: list[Point], stations: list[Point], drawn: list[int], count: int, charging: set[int]
) -> None:
    """Whoever is in the way of one that goes before it leaves; no two leave each other's way."""
    number = min(len(at), len(stations))
    at, stations = at[:number], stations[:number]
    order = [each for each in drawn if each <= number][:count]
    at = [stations[k] if k + 1 in charging and k + 1 not in order else at[k] for k in range(number)]
    meeting = Homing(at, stations)
    for robot_id in charging & set(meeting.robots) - set(order):
        meeting.mode(robot_id, "battery", Controller.SC, 0.0)
    for step, robot_id in enumerate(order):
        meeting.home(robot_id, now_s=NOW_S + step)
    order = [robot_id for robot_id in order if math.dist(at[robot_id - 1], stations[robot_id - 1]) >= 0.2]
    meeting.look(NOW_S + count + 2.0)
    leaving = meeting.leaving()
    for robot_id, place in enumerate(at, start=1):
        before = order[: order.index(robot_id)] if robot_id in order else order
        docked = math.dist(place, stations[robot_id - 1]) < 0.2
        near = any(from_line(*place, at[other - 1], stations[other - 1]) < APART_M - 1e-9 for other in before)
        charges = docked and meeting.rigs[robot_id].modules["battery"].mode is Controller.SC
        if near and not charges:
            assert robot_id in leaving
        if robot_id in leaving:
            assert before
            assert leaving[robot_id].robot_id == before[0]
    assert not order or order[0] not in leaving


# --- what the controllers make of it -----------------------------------------------------------------------


class Waiting(Says):
    """The path of the robot is not clear until the test says so."""

    clear = False

    def path_is_clear(self, robot_id: int) -> bool:
        return self.clear


@pytest.mark.parametrize(("first", "patient_s"), [(True, FIRST_PATIENT_S), (False, PATIENT_S)])
def test_who_does_not_get_along_its_path_makes_room_after_some_time(first: bool, patient_s: float) -> None:
    """Whoever has to leave the path may be able to do so past the first only."""
    made = Controllers(EMPTY)
    made.dock.wants_charge = True
    rule = Waiting(first)
    # Between the robot and its station, so near that no leg along the path is certified.
    robot = Follower(made, made.back_away(rule), (2.5, 1.0), (2.1, 1.0))
    start = robot.place
    while robot.now_s < patient_s - 0.1:
        robot.step()
    assert math.dist(robot.place, start) < 0.03, "it waits"
    assert math.dist(robot.place, robot.peers[0]) < 0.41
    robot.run(4.0)
    assert math.dist(robot.place, robot.peers[0]) > made.recovery.apart_m(0.0) - 0.03, "it makes room"
    rule.clear = True
    robot.peers = ((2.1, 4.0),)
    robot.run(ASIDE_S)
    assert robot.home_m() < 0.03


def test_who_has_to_leave_a_path_gets_off_it_and_stays_off_it() -> None:
    made = Controllers(EMPTY)
    rule = RightOfWay()
    path = Path(2, (((4.5, 2.5), (0.5, 2.5)),), made.recovery.apart_m(0.0))
    rule._to_leave[1] = path
    robot = Follower(made, made.back_away(rule), (2.5, 2.4), (4.5, 2.5))
    robot.run(20.0)
    assert not path.near(*robot.place)
    before = robot.place
    robot.run(10.0)
    assert math.dist(robot.place, before) < 0.05


def test_who_makes_room_is_not_sent_into_a_corner_behind_the_station_of_who_comes() -> None:
    made, corner, coming = Controllers(EMPTY), At(0.15, 0.15), At(4.5, 4.5, robot_id=2)
    made.refuges.aside = True
    for ends, shut_in in (((), True), (((0.9, 0.9),), False)):
        made.refuges.leave = Path(2, (((4.5, 4.5), (2.0, 2.0)),), 1.0, ends)
        x_m, y_m = made.refuges.way(seen(corner, [coming]), 0.3)[-1]
        assert (max(x_m, y_m) < 0.9) is shut_in
    walled = Controllers(Terrain(Workspace(5.0, 5.0, (Box(0.0, 0.5, 0.6, 0.6), Box(0.5, 0.0, 0.6, 0.5)), ()), 0.105))
    walled.refuges.aside, walled.refuges.leave = True, made.refuges.leave
    assert walled.refuges.way(seen(corner, [coming]), 0.3), "better there than nowhere"


# --- in closed loop ----------------------------------------------------------------------------------------

Ports = Mapping[int, RobotPort]


def station(x_m: float, y_m: float) -> Box:
    return Box(x_m - 0.2, y_m - 0.2, x_m + 0.2, y_m + 0.2)


def room(side_m: float, *starts: Point) -> Workspace:
    places_ = tuple(RobotPlace(number, *at, station(*at)) for number, at in enumerate(starts, start=1))
    return Workspace(side_m, side_m, (), places_)


def test_an_ac_that_parks_on_anothers_station_does_not_keep_it_from_charging() -> None:
    def park(now_s: float, ports: Ports) -> None:
        if now_s > 20.0:
            goto(ports[1], 3.0, 3.0)
        goto(ports[2], *[(1.0, 3.0), (3.0, 1.0)][int(now_s / 30.0) % 2])

    made = Loop(park, (1.0, 0.55), room(4.0, (1.0, 1.0), (3.0, 3.0)), battery__drive_s=400.0, battery__idle_s=400.0)
    made.until_charged(120.0, 2)
    assert any(s.after is not None and s.module == "collision" for s in made.switches)
    assert made.run(1.0).violations == ()


@pytest.mark.parametrize(("count", "charge"), [(3, 0.4), (4, 0.5)])
def test_robots_that_have_to_charge_at_once_get_home_one_by_one(count: int, charge: float) -> None:
    """They crowd in the middle of a small room when their charge runs low."""
    corners: list[Point] = [(0.7, 0.7), (3.3, 3.3), (0.7, 3.3), (3.3, 0.7)]

    def crowd(now_s: float, ports: Ports) -> None:
        for port in ports.values():
            goto(port, 2.0, 2.0)

    made = Loop(crowd, (charge,) * count, room(4.0, *corners[:count]), battery__drive_s=900.0, battery__idle_s=900.0)
    made.until_charged(240.0)
    assert made.run(1.0).violations == ()


@pytest.mark.parametrize("side_deg", range(0, 360, 30))
@pytest.mark.parametrize("far_m", [0.34, 0.4])
def test_a_robot_that_is_low_gets_away_from_one_that_charges_for_long(side_deg: int, far_m: float) -> None:
    side_rad = math.radians(side_deg)
    x, y = 1.0 + far_m * math.cos(side_rad), 1.0 + far_m * math.sin(side_rad)
    places = [(1.0, 1.0, Box(0.8, 0.8, 1.2, 1.2)), (x, y, Box(2.3, 1.8, 2.7, 2.2))]
    space = Workspace(5.0, 5.0, (), tuple(RobotPlace(each, *place) for each, place in enumerate(places, start=1)))

    def ram(now_s: float, ports: Mapping[int, RobotPort]) -> None:
        goto(ports[1], 1.5, 1.2)
        goto(ports[2], 1.0, 1.0)

    made = Loop(ram, (0.03, 0.05), space, battery__charge_s=600.0)
    for _ in range(30):
        made.run(1.0)
        if math.dist(where(made.ports[2]), (2.5, 2.0)) < 0.1:
            break
    else:
        pytest.fail(f"robot 2 is at {where(made.ports[2])} with {made.charge(2)}, robot 1 {where(made.ports[1])}")
    assert math.dist(where(made.ports[1]), (1.0, 1.0)) < 0.1, "it has charged all the time"
    assert made.run(0.0).violations == ()
