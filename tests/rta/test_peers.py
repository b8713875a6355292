"""Robots that are silent: their own supervisor lets them stop, others hold, and everybody knows how far they can be."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import (
    PEER_SILENT_S,
    PeerMonitor,
    Sample,
    SpeedBound,
    StillPeers,
    Supervisor,
)
from soter.rta.assumptions import Assumption
from soter.rta.monitors import BrokenAssumption
from soter.sdk import Controller
from tests.rta.doubles import TICK_S, At, Rig

V_MAX, BRAKE = 0.22, 1.0
STILL_S = 0.8


class Far:
    """A robot of another supervisor, of which a test says what is heard."""

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self.latest: Sample | None = None
        self.heard_s = -math.inf
        self.wrong: BrokenAssumption | None = None

    def sample(self) -> Sample | None:
        return self.latest

    def heard_of(self, robot_id: int) -> float:
        return self.heard_s

    def needs_charge(self) -> bool:
        return False

    def found(self) -> BrokenAssumption | None:
        wrong, self.wrong = self.wrong, None
        return wrong


SPEED = SpeedBound(V_MAX, BRAKE)


class Meeting:
    """One robot under a supervisor, and one of another that it hears of."""

    def __init__(self) -> None:
        self.rig = Rig("a", robot_id=2)
        self.far = Far(1)
        self.ticks = 0
        self.supervisor = Supervisor(
            [self.rig.robot], TICK_S, 2.5, peers=PeerMonitor(dict.fromkeys((1, 2), (SPEED, 0.0)), PEER_SILENT_S),
            still=StillPeers(STILL_S), remote=[self.far],
        )  # fmt: skip

    @property
    def now_s(self) -> float:
        return self.ticks * TICK_S

    @property
    def engaged(self) -> bool:
        """Whether the AC has control."""
        return self.rig.robot.mode is Controller.AC

    def tick(self, count: int = 1, *, hears: bool = True, is_heard: bool = True) -> None:
        for _ in range(count):
            self.rig.actuator.sample = At(10.0, stamp_s=self.now_s, robot_id=2)
            if hears:
                self.far.latest = At(13.0, stamp_s=self.now_s, robot_id=1)
            if is_heard:
                self.far.heard_s = self.now_s
            self.rig.actuator.calls.clear()
            self.supervisor.tick(self.now_s)
            self.ticks += 1

    @property
    def stands(self) -> bool:
        """Whether the robot was told to stop at the last tick, and nothing else but to live on."""
        orders = [call for call in self.rig.actuator.calls if call[0] == "drive"]
        return bool(orders) and all(call[1] is None for call in orders)


@pytest.fixture
def meeting() -> Meeting:
    found = Meeting()
    found.tick(20)
    assert found.engaged
    return found


@given(st.floats(0.0, 5.0), st.floats(0.0, STILL_S - V_MAX / (2.0 * BRAKE)))
def test_a_robot_that_has_come_to_rest_is_no_farther_than_is_said(later_s: float, moves_s: float) -> None:
    """It drives at top speed for as long as it may, and brakes."""
    braking_s = min(max(later_s - moves_s, 0.0), V_MAX / BRAKE)
    way_m = V_MAX * min(later_s, moves_s) + V_MAX * braking_s - BRAKE * braking_s**2 / 2.0
    seen = StillPeers(STILL_S).bounded(10.0 + later_s, At(1.0, stamp_s=10.0))
    assert way_m <= V_MAX * (10.0 + later_s - seen.stamp_s) + 1e-9
    assert (seen.x_m, seen.robot_id) == (1.0, 1)
    assert 10.0 + later_s - seen.stamp_s <= STILL_S + 1e-9


def test_a_sample_of_a_robot_that_may_still_move_is_left_as_it_is() -> None:
    sample = At(1.0, stamp_s=10.0)
    assert StillPeers(STILL_S).bounded(10.0 + STILL_S - 1e-6, sample) is sample


def test_a_robot_that_is_not_heard_of_is_not_driven_on() -> None:
    rigs = [Rig("a", robot_id=1, heard_within_s=PEER_SILENT_S), Rig("a", robot_id=2, heard_within_s=PEER_SILENT_S)]
    supervisor = Supervisor([rig.robot for rig in rigs], TICK_S, 2.5)
    renewed = {}
    for tick in range(60):
        for rig in rigs:
            rig.actuator.calls.clear()
        rigs[0].actuator.sample = At(10.0, stamp_s=tick * TICK_S, robot_id=1)
        if not 20 <= tick < 50:
            rigs[1].actuator.sample = At(13.0, stamp_s=tick * TICK_S, robot_id=2)
        supervisor.tick(tick * TICK_S)
        renewed[tick] = [("renew",) in rig.actuator.calls for rig in rigs]
    assert all(renewed[tick] == [True, (tick - 19) * TICK_S <= PEER_SILENT_S] for tick in range(20, 50))
    assert all(renewed[tick] == [True, True] for tick in range(50, 60))


def test_a_peer_of_another_supervisor_is_a_peer(meeting: Meeting) -> None:
    assert [peer.robot_id for peer in meeting.rig.robot.situation.peers] == [1]
    meeting.tick(40, hears=False)
    (seen,) = meeting.rig.robot.situation.peers
    assert seen.x_m == 13.0
    assert seen.stamp_s == pytest.approx(meeting.now_s - TICK_S - STILL_S)


def test_who_has_not_heard_of_a_peer_yet_stands() -> None:
    meeting = Meeting()
    meeting.tick(20, hears=False)
    assert meeting.stands
    assert "robot 1: not heard of yet" in meeting.rig.robot.log.breaches[Assumption.PEERS].cause


@pytest.mark.parametrize(
    ("hears", "is_heard", "cause"),
    [
        (False, True, "robot 1: not heard of for 0.5"),
        (True, False, "robot 1 is not known to have heard of this one for 0.5"),
        (False, False, "robot 1: not heard of for 0.5"),
    ],
)
def test_both_sides_of_a_cut_stand_until_it_is_mended(
    meeting: Meeting, hears: bool, is_heard: bool, cause: str
) -> None:
    for tick in range(1, 40):
        meeting.tick(hears=hears, is_heard=is_heard)
        assert meeting.stands is (tick * TICK_S > PEER_SILENT_S + 1e-9)
        assert ("renew",) in meeting.rig.actuator.calls, "it is heard of by its own supervisor, and stands by itself"
    robot, sc = meeting.rig.robot, meeting.rig.scs["a"]
    assert not meeting.engaged
    assert cause in robot.log.breaches[Assumption.PEERS].cause
    steps, engaged = sc.steps, sc.engaged
    meeting.tick()
    assert (sc.steps, sc.engaged) == (steps + 1, engaged + 1), "where it was going was dropped"
    assert not meeting.stands
    meeting.tick(20)
    assert meeting.engaged


def test_a_robot_that_stands_does_so_whoever_would_drive(meeting: Meeting) -> None:
    meeting.rig.robot.fail_ac("it is gone")
    meeting.tick(20, hears=False)
    assert meeting.stands
    meeting.rig.actuator.failing.add("drive")
    meeting.tick(hears=False)
    assert ("renew",) not in meeting.rig.actuator.calls, "a robot that cannot be told to stop is not driven on"


def test_a_margin_that_falls_for_silence_alone_is_no_failure_of_the_safe_controllers(meeting: Meeting) -> None:
    meeting.tick(20, hears=False)
    assert not meeting.engaged
    meeting.rig.rules["a"].value = -0.1
    meeting.tick(5, hears=False)
    assert Assumption.RECOVERY not in meeting.rig.robot.log.breaches
    meeting.tick()
    assert Assumption.RECOVERY in meeting.rig.robot.log.breaches, "now the peer is heard of, and it is too near"


def test_a_remote_peer_that_breaks_its_bound_costs_control(meeting: Meeting) -> None:
    meeting.far.wrong = BrokenAssumption(Assumption.PEERS, "robot 1: sample outside the reach set")
    meeting.tick()
    assert not meeting.engaged
    assert not meeting.stands
    meeting.tick(20)
    assert meeting.engaged
