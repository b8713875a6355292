"""The supervisor's end: never waits, never raises, and has done with a mission that does not keep to the rules."""

from __future__ import annotations

import math

import pytest

from soter.errors import Garbage
from soter.isolation.child import ChildDied
from soter.isolation.messages import (
    Ask,
    Begin,
    Begun,
    Busy,
    FailedForGood,
    Moved,
    Reported,
    Started,
    TargetEndedMessage,
    TargetGiven,
    Tick,
    Turn,
    decode_down,
    encode,
)
from soter.isolation.refused import Refused
from soter.isolation.supervisor_end import BEGIN_S, MAX_MESSAGES, MAX_REPORTS, MAX_WAITING
from soter.rta import ControlReport, GoalReport, Request
from soter.sdk import Waypoint
from tests.isolation.ends import SILENT_S, Rig, state


def told(rig: Rig) -> list[Begin | Tick]:
    return [decode_down(data) for data in rig.child.told]


def failure(rig: Rig) -> str:
    return rig.end.failure


def last_tick(rig: Rig) -> Tick:
    last = told(rig)[-1]
    assert isinstance(last, Tick)
    return last


def test_a_mission_hears_of_its_robots_and_of_every_tick() -> None:
    rig = Rig()
    begin = told(rig)[0]
    assert isinstance(begin, Begin)
    assert begin.robot_ids == (1, 2)
    rig.ports[2].control(True, "geofence", "inside again")
    assert rig.tick(Turn(1)) == [Turn(1)]
    tick = last_tick(rig)
    assert tick.number == 1
    assert tick.states == (state(1), state(2))
    assert tick.reports == (Reported(control=ControlReport(2, True, "geofence", "inside again")),)
    rig.tick(Turn(2))
    assert last_tick(rig).reports == ()
    assert not rig.end.failure


def test_what_it_asks_for_lies_in_the_port_under_its_own_number() -> None:
    rig = Rig()
    rig.ports[1].control(True, "", "")
    rig.tick(Turn(1, (Ask(1, 1, 77, Waypoint(1.0, 2.0), (Waypoint(3.0, 4.0),)),)))
    assert rig.ports[1].take() == Request(77, Waypoint(1.0, 2.0), (Waypoint(3.0, 4.0),))
    assert rig.ports[2].take() is None


def test_what_it_asked_for_before_a_hand_over_is_rejected_after_it() -> None:
    rig = Rig()
    rig.ports[1].control(True, "", "")
    rig.ports[1].control(False, "geofence", "")
    rig.ports[1].control(True, "geofence", "")
    rig.tick(Turn(1, (Ask(1, 1, 5, Waypoint(1.0, 2.0)),)))
    assert rig.ports[1].take() is None
    rig.tick(Turn(2))
    assert [report.goal.goal_id for report in last_tick(rig).reports if report.goal is not None][:1] == [5]


def test_a_turn_may_leave_ticks_out_but_answers_none_twice_nor_early() -> None:
    rig = Rig()
    rig.tick()
    rig.tick()
    rig.tick(Turn(3))
    assert not rig.end.failure
    rig.tick(Turn(3))
    assert "garbage: an answer to tick 3, expected: 4 to 4" in rig.end.failure
    rig = Rig()
    rig.tick(Turn(2))
    assert "garbage: an answer to tick 2, expected: 1 to 1" in rig.end.failure


def test_a_task_planner_says_what_robots_of_other_processes_are_given_and_commands_none_of_them() -> None:
    rig = Rig(peers=(7,))
    news = (TargetGiven(7, 1, 2.0, 3.0), TargetEndedMessage(7, 1, "reached"), TargetGiven(1, 2, 4.0, 5.0))
    assert rig.tick(Turn(1, news=news)) == [Turn(1, news=news)]
    assert not rig.end.failure
    rig.tick(Turn(2, (Ask(7, 0, 1, Waypoint(1.0, 2.0)),)))
    assert "garbage: there is no robot 7" in rig.end.failure


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        (Turn(1, (Ask(3, 0, 1, Waypoint(1.0, 2.0)),)), "there is no robot 3"),
        (Turn(1, news=(TargetEndedMessage(9, 1, "reached"),)), "there is no robot 9"),
        (Turn(1, failures=(FailedForGood(0, "why"),)), "there is no robot 0"),
        (Turn(1, news=(TargetGiven(1, 1, math.nan, 0.0),)), "a target that is not finite"),
        (Turn(1, moves=(Moved(math.inf, "", 1, "", "", "", "", ""),)), "a time that is not finite"),
    ],
)
def test_what_makes_no_sense_is_garbage(turn: Turn, words: str) -> None:
    rig = Rig()
    assert rig.tick(turn) == []
    assert words in rig.end.failure
    assert rig.child.killed


@pytest.mark.parametrize("data", [b"", b"\xc1", b"turn", encode(Started()), encode(Refused("other", "no"))])
def test_garbage_ends_it(data: bytes) -> None:
    rig = Rig()
    rig.child.said.append(data)
    rig.tick(Turn(1))
    assert "garbage" in rig.end.failure
    assert rig.child.killed


def test_silence_counts_from_a_tick_that_was_not_answered() -> None:
    rig = Rig()
    rig.tick(Turn(1), lasts_s=10.0 * SILENT_S)
    rig.silence(0.9 * SILENT_S)
    assert not rig.end.failure
    rig.silence(0.2 * SILENT_S)
    assert failure(rig) == "it has been silent for 2 s of host time"


def test_the_beginning_may_take_long_and_is_said_to_be_over_once() -> None:
    rig = Rig()
    rig.tick()
    rig.silence(0.9 * BEGIN_S)
    rig.child.said.append(encode(Begun()))
    rig.silence(0.9 * SILENT_S)
    assert not rig.end.failure
    rig.silence(0.2 * SILENT_S)
    assert failure(rig) == "it has been silent for 2 s of host time"
    rig = Rig()
    rig.child.said += [encode(Begun()), encode(Begun())]
    rig.tick()
    assert failure(rig) == "it sent garbage: a first message, later"
    rig = Rig()
    rig.tick()
    rig.silence(1.1 * BEGIN_S)
    assert failure(rig) == "it has been silent for 60 s of host time"


def test_a_mission_that_was_stopped_with_its_supervisor_was_not_silent() -> None:
    rig = Rig()
    rig.tick(lasts_s=3600.0)
    assert not rig.end.failure
    assert rig.tick(Turn(1))
    rig.silence(1.1 * SILENT_S)
    assert failure(rig) == "it has been silent for 2 s of host time"


def test_a_handler_that_hangs_is_named() -> None:
    rig = Rig()
    rig.tick(Turn(1))
    rig.child.said.append(encode(Busy("Planner: Planner.Waiting")))
    rig.silence(1.1 * SILENT_S)
    assert rig.end.failure.endswith("it is in handler Planner: Planner.Waiting")


def test_a_handler_that_came_back_is_not_blamed() -> None:
    rig = Rig()
    rig.child.said.append(encode(Busy("Planner: Planner.Waiting")))
    rig.tick(Turn(1))
    rig.silence(1.1 * SILENT_S)
    assert "Planner" not in rig.end.failure


def test_a_closed_link_is_a_failure_and_says_how_the_process_ended() -> None:
    rig = Rig()
    rig.child.closed = True
    rig.tick()
    assert not rig.end.failure
    rig.child.ended = "signal SIGSEGV"
    rig.tick()
    assert failure(rig) == "its process has ended with signal SIGSEGV"


def test_a_link_that_a_living_process_closes_is_a_failure() -> None:
    rig = Rig()
    rig.child.closed = True
    for _ in range(9):
        rig.tick()
    # One that has crashed is given half a second until its end is known.
    assert not failure(rig)
    for _ in range(2):
        rig.tick()
    assert failure(rig) == "its process has closed the link"
    assert rig.child.killed


def test_a_tick_reads_a_few_messages_and_leaves_the_rest() -> None:
    rig = Rig()
    rig.child.said.extend(encode(Busy("a")) for _ in range(100))
    rig.tick()
    assert len(rig.child.said) == 100 - MAX_MESSAGES
    rig = Rig()
    rig.child.said.extend(encode(Turn(n, incidents=("x" * 300,) * 200)) for n in range(1, 5))
    for _ in range(4):
        rig.end.send(0.0, 0.0, [None, None])
    assert len(rig.end.receive()) == 2, "so many bytes are enough"


def test_states_are_replaced_and_reports_kept_while_there_is_no_room() -> None:
    rig = Rig()
    rig.child.room = 1
    rig.ports[1].report(1, "reached")
    rig.tick()
    rig.ports[1].report(2, "failed")
    rig.tick()
    rig.child.room = 10
    rig.tick(Turn(1))
    assert len(told(rig)) == 2
    assert last_tick(rig).number == 1
    assert len(last_tick(rig).reports) == 2
    assert not rig.end.failure


def test_reports_go_in_portions() -> None:
    rig = Rig()
    for number in range(MAX_REPORTS + 1):
        rig.ports[1].report(number, "failed")
    rig.tick(Turn(1))
    assert len(last_tick(rig).reports) == MAX_REPORTS
    rig.tick(Turn(2))
    assert len(last_tick(rig).reports) == 1


def test_a_mission_that_takes_no_reports_has_failed() -> None:
    rig = Rig()
    for number in range(MAX_WAITING + 1):
        rig.end.hear(GoalReport(1, number, "failed"))
    assert f"takes no reports: {MAX_WAITING} wait" in rig.end.failure


def test_nothing_counts_after_a_failure() -> None:
    rig = Rig()
    rig.ports[1].control(True, "", "")
    rig.end.fail("first")
    rig.end.fail("second")
    rig.ports[1].report(1, "failed")
    before = len(rig.child.told)
    assert rig.tick(Turn(1, (Ask(1, 1, 1, Waypoint(1.0, 2.0)),))) == []
    assert len(rig.child.told) == before
    assert rig.ports[1].take() is None
    assert rig.end.failure == "first"


def test_the_first_message_is_that_it_has_started_or_why_not() -> None:
    rig = Rig()
    assert rig.end.await_start(0.0) is None
    rig.child.said.append(encode(Started()))
    assert rig.end.await_start(0.0) == Started()
    rig.child.said.append(encode(Turn(1)))
    with pytest.raises(Garbage, match="another kind"):
        rig.end.await_start(0.0)
    rig.child.closed = True
    with pytest.raises(ChildDied):
        rig.end.await_start(0.0)
