"""Who goes first when robots meet; progress rests on it, safety never does."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import RobotSupervisor, Situation
from soter.sdk import Controller
from soter.stack.right_of_way import CLEAR_M, LOW_CHARGE, MEMORY_S, NEAR_M, PATIENCE_S, TURN_S, WAIT_S, RightOfWay
from soter.stack.terrain import Point
from tests.rta.doubles import At, Rig


class Meeting:
    """Some robots whose places, charges and modes the test sets."""

    def __init__(
        self, *places: Point, rule: RightOfWay | None = None, modules: tuple[str, ...] = ("collision", "battery")
    ) -> None:
        self.rule = rule or RightOfWay()
        self.rigs = {number: Rig(*modules, robot_id=number) for number in range(1, len(places) + 1)}
        self.robots: dict[int, RobotSupervisor] = {number: rig.robot for number, rig in self.rigs.items()}
        for robot in self.robots.values():
            for module in robot.modules:
                module.mode = Controller.AC
        self.samples: dict[int, At] = {}
        for number, place in enumerate(places, start=1):
            self.put(number, place)

    def put(self, number: int, place: Point, battery: float = 1.0) -> None:
        self.samples[number] = At(*place, robot_id=number, battery=battery)

    def mode(self, number: int, module: str, mode: Controller, since_s: float = 0.0) -> None:
        made = self.rigs[number].modules[module]
        made.mode, made.since_s = mode, since_s

    def look(self, now_s: float) -> None:
        for number, robot in self.robots.items():
            robot.situation.own = self.samples[number]
            robot.situation.now_s = now_s
            robot.situation.peers = [sample for other, sample in self.samples.items() if other != number]
        self.rule.update(now_s, self.robots)

    def order(self, number: int = 1) -> tuple[int, ...] | None:
        encounter = self.rule.encounter(number)
        return None if encounter is None else encounter.order

    def permits(self, number: int, module: str = "collision") -> bool:
        situation: Situation = self.robots[number].situation
        known = self.rigs[number].modules.get(module)
        return self.rule.permits(module, situation, math.inf if known is None else known.since_s)


NEAR: tuple[Point, Point] = ((0.0, 0.0), (NEAR_M - 0.01, 0.0))


def test_robots_that_are_near_meet_and_the_lowest_id_goes_first() -> None:
    meeting = Meeting(*NEAR, (3.0, 0.0))
    meeting.look(0.0)
    assert meeting.order(1) == meeting.order(2) == (1, 2)
    assert meeting.order(3) is None
    assert [meeting.rule.first(number) for number in (1, 2, 3)] == [True, False, True]


@pytest.mark.parametrize(("unsure_m", "order"), [(0.3, (1, 2)), (0.0, None)])
def test_robots_that_are_not_given_back_because_they_are_seen_badly_meet_too(
    unsure_m: float, order: tuple[int, int] | None
) -> None:
    # Two that both took themselves for the first held for ever, between phi_safer and where they would be given back.
    meeting = Meeting((0.0, 0.0), (1.15, 0.0), rule=RightOfWay(safer_m=0.9, unsure_m=unsure_m))
    meeting.look(0.0)
    assert meeting.order() == order


def test_who_meets_is_passed_on() -> None:
    meeting = Meeting((1.0, 0.0), (0.0, 0.0), (1.5, 0.0), (0.5, 0.0), (9.0, 0.0))
    meeting.look(0.0)
    assert meeting.order(3) == (1, 2, 3, 4)
    assert meeting.order(5) is None


def test_an_encounter_ends_some_time_after_its_robots_part() -> None:
    meeting = Meeting(*NEAR)
    meeting.look(0.0)
    meeting.put(2, (2.0, 0.0))
    meeting.look(MEMORY_S)
    assert meeting.order() == (1, 2)
    meeting.look(MEMORY_S + 0.05)
    assert meeting.order() is None
    meeting.look(100.0)
    assert meeting.permits(2)


def test_the_order_rotates() -> None:
    meeting = Meeting((0.0, 0.0), (0.5, 0.0), (0.25, 0.4))
    firsts = []
    for turn in range(4):
        meeting.look(turn * TURN_S)
        meeting.look(turn * TURN_S + 0.99 * TURN_S)
        order = meeting.order()
        assert order is not None
        firsts.append(order[0])
        assert sorted(order) == [1, 2, 3]
    assert firsts == [1, 2, 3, 1]


@pytest.mark.parametrize(
    ("battery", "mode", "order"),
    [
        (LOW_CHARGE - 0.01, Controller.SC, (2, 1)),
        (LOW_CHARGE + 0.01, Controller.SC, (1, 2)),
        (LOW_CHARGE - 0.01, Controller.AC, (1, 2)),
    ],
)
def test_who_is_low_and_on_its_way_to_charge_goes_first(
    battery: float, mode: Controller, order: tuple[int, ...]
) -> None:
    meeting = Meeting(*NEAR)
    meeting.put(2, NEAR[1], battery)
    meeting.mode(2, "battery", mode)
    meeting.look(0.0)
    assert meeting.order() == order


def test_only_the_first_may_go_while_they_are_close() -> None:
    meeting = Meeting(*NEAR)
    meeting.mode(1, "collision", Controller.SC, 10.0)
    meeting.mode(2, "collision", Controller.SC, 10.0)
    meeting.look(10.0)
    assert meeting.permits(1)
    assert not meeting.permits(2)
    assert meeting.permits(2, "obstacle"), "the other modules need no permission"


def test_the_others_wait_for_distance_or_for_some_time() -> None:
    meeting = Meeting(*NEAR)
    meeting.mode(2, "collision", Controller.SC, 10.0)
    meeting.look(10.0)
    meeting.put(2, (CLEAR_M - 0.01, 0.0))
    meeting.look(11.0)
    assert not meeting.permits(2)
    meeting.put(2, (CLEAR_M + 0.01, 0.0))
    meeting.look(12.0)
    assert meeting.permits(2)
    meeting.put(2, NEAR[1])
    meeting.look(10.0 + PATIENCE_S - 0.05)
    assert not meeting.permits(2)
    meeting.look(10.0 + PATIENCE_S)
    assert meeting.permits(2)


def test_a_group_that_grows_keeps_the_turn_of_its_oldest_part() -> None:
    meeting = Meeting(*NEAR, (3.0, 0.0))
    meeting.look(0.0)
    meeting.put(3, (0.9, 0.0))
    meeting.look(TURN_S)
    assert meeting.order() == (2, 3, 1)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0)), min_size=1, max_size=8), st.floats(0.0, 100.0))
def test_everybody_is_in_one_order_at_most_and_somebody_is_first(places: list[Point], now_s: float) -> None:
    meeting = Meeting(*places)
    meeting.look(0.0)
    meeting.look(now_s)
    for number, place in enumerate(places, start=1):
        encounter = meeting.rule.encounter(number)
        close = [
            other
            for other, at in enumerate(places, start=1)
            if other != number and math.dist(at, place) < NEAR_M - 1e-9
        ]
        if encounter is None:
            assert not close
            continue
        assert set(encounter.order) == encounter.members
        assert {number, *close} <= encounter.members
        assert all(meeting.rule.encounter(member) is encounter for member in encounter.members)
        assert sum(meeting.rule.first(member) for member in encounter.members) == 1


@pytest.mark.parametrize(
    ("waited_s", "held"), [(29.0, False), (31.0, True), (119.0, True), (121.0, False), (151.0, True)]
)
def test_peers_keep_away_from_a_robot_that_waits_for_longer_than_it_has_waited(waited_s: float, held: bool) -> None:
    assert WAIT_S == 30.0
    # The second lingers within phi_safer, the third is the nearest of nobody.
    meeting = Meeting((0.0, 0.0), (0.8, 0.0), (2.5, 0.0), rule=RightOfWay(safer_m=0.9))
    meeting.mode(1, "collision", Controller.SC, since_s=10.0)
    meeting.look(10.0 + waited_s)
    assert (meeting.rigs[2].modules["collision"].mode is Controller.SC) is held
    assert meeting.rigs[3].modules["collision"].mode is Controller.AC
    assert meeting.permits(3)


def test_the_nearest_peer_keeps_away_even_beyond_phi_safer() -> None:
    meeting = Meeting((0.0, 0.0), (0.95, 0.0), (0.0, 1.5), rule=RightOfWay(safer_m=0.9))
    meeting.mode(1, "collision", Controller.SC, since_s=10.0)
    meeting.look(45.0)
    assert [meeting.permits(number) for number in (2, 3)] == [False, True]


def test_a_peer_that_stands_in_the_way_of_any_module_keeps_away_but_not_one_that_is_far() -> None:
    meeting = Meeting((0.0, 0.0), (0.5, 0.0), (0.0, 1.5), modules=("zone", "collision", "battery"))
    meeting.mode(1, "zone", Controller.SC, since_s=10.0)
    meeting.look(45.0)
    assert [meeting.rigs[number].modules["collision"].mode for number in (2, 3)] == [Controller.SC, Controller.AC]


def test_nobody_keeps_away_from_a_robot_whose_ac_has_failed_or_that_charges() -> None:
    meeting = Meeting((0.0, 0.0), (0.8, 0.0), rule=RightOfWay(safer_m=0.9))
    meeting.mode(1, "collision", Controller.SC, since_s=10.0)
    meeting.mode(1, "battery", Controller.SC, since_s=10.0)
    meeting.look(45.0)
    meeting.mode(1, "battery", Controller.AC)
    meeting.robots[1].fail_ac("it raised")
    meeting.look(45.0)
    assert meeting.rigs[2].modules["collision"].mode is Controller.AC
