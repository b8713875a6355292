"""The mission's end: ports that behave like the supervisor's own."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from soter.isolation.messages import (
    MAX_ANNOUNCED,
    MAX_TURN_BYTES,
    Ask,
    Begin,
    Busy,
    PeerSeen,
    Reported,
    Started,
    TargetGiven,
    Tick,
    Turn,
    decode_up,
    encode,
)
from soter.rta import ControlReport, GoalReport
from soter.sdk import RobotState, Waypoint
from tests.isolation.ends import ROOM, Pair, state


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair()
    made.supervisor.send(encode(Begin(5.0, 1.0, (1, 2), (ROOM, ROOM))))
    made.end.wait()
    yield made
    made.close()


def test_a_supervisor_that_went_before_it_was_told_is_gone_and_no_fault() -> None:
    pair = Pair()
    pair.supervisor.close()
    pair.end.say(Started())
    assert pair.end.wait() is None
    pair.close()


def tick(pair: Pair, number: int, *reports: Reported, states: tuple[RobotState, ...] | None = None) -> None:
    states = states or (state(1), state(2))
    pair.supervisor.send(encode(Tick(number, 5.0, 5.0, 1.0, states, reports)))
    pair.end.wait()


def answer(pair: Pair, turn: Turn | None = None) -> Turn:
    pair.end.answer(turn or Turn(0))
    sent = decode_up(pair.supervisor.recv(MAX_TURN_BYTES + 1, socket.MSG_DONTWAIT))
    assert isinstance(sent, Turn)
    return sent


def test_ports_show_what_the_supervisor_tells(pair: Pair) -> None:
    tick(pair, 1, Reported(control=ControlReport(1, True, "geofence", "inside")), states=(state(1, 3.0), state(2)))
    assert pair.end.ports[1].state == state(1, 3.0)
    assert (pair.end.ports[1].engaged, pair.end.ports[2].engaged) == (True, False)
    assert pair.heard == [ControlReport(1, True, "geofence", "inside")]
    tick(
        pair, 2, Reported(goal=GoalReport(1, 4, "reached")), Reported(control=ControlReport(1, False, "battery", "low"))
    )
    assert pair.heard[1:] == [GoalReport(1, 4, "reached"), ControlReport(1, False, "battery", "low")]
    assert not pair.end.ports[1].engaged


def test_all_that_waits_is_taken_at_once_and_the_newest_states_count(pair: Pair) -> None:
    for number in (1, 2, 3):
        reports = (Reported(goal=GoalReport(1, number, "failed")),)
        pair.supervisor.send(encode(Tick(number, 5.0, 5.0, 1.0, (state(1, float(number)), None), reports)))
    messages = pair.end.wait()
    assert messages is not None
    assert len(messages) == 3
    assert pair.end.ports[1].state == state(1, 3.0)
    assert [report.goal_id for report in pair.heard if isinstance(report, GoalReport)] == [1, 2, 3]
    assert answer(pair).tick == 3


def test_the_newest_goto_of_every_robot_is_asked_for(pair: Pair) -> None:
    tick(pair, 1, Reported(control=ControlReport(1, True, "", "")), Reported(control=ControlReport(2, True, "", "")))
    ports = pair.end.ports
    replaced = ports[1].goto(Waypoint(1.0, 1.0))
    first = ports[1].goto(Waypoint(2.0, 2.0), (Waypoint(3.0, 3.0),))
    second = ports[2].goto(Waypoint(math.nan, 4.0))
    asks = answer(pair).asks
    assert asks[0] == Ask(1, 1, first, Waypoint(2.0, 2.0), (Waypoint(3.0, 3.0),))
    assert (asks[1].goal_id, math.isnan(asks[1].target.x_m)) == (second, True)
    assert pair.heard[-1] == GoalReport(1, replaced, "superseded")
    assert answer(pair).asks == ()


def test_without_control_nothing_is_asked_for(pair: Pair) -> None:
    tick(pair, 1)
    goal = pair.end.ports[1].goto(Waypoint(1.0, 1.0))
    assert answer(pair).asks == ()
    assert pair.heard == [GoalReport(1, goal, "rejected")]


def test_an_ask_says_how_many_hand_overs_it_knew_of(pair: Pair) -> None:
    tick(
        pair,
        1,
        Reported(control=ControlReport(1, True, "", "")),
        Reported(control=ControlReport(1, False, "", "")),
        Reported(control=ControlReport(1, True, "", "")),
    )
    pair.end.ports[1].goto(Waypoint(1.0, 1.0))
    assert answer(pair).asks[0].handover == 3


class Odd(Waypoint):
    """A look-alike."""


@pytest.mark.parametrize(
    "command",
    [None, "there", (1.0, 2.0), Odd(1.0, 2.0), Waypoint("1", 2.0), Waypoint(None, 2.0), Waypoint(10**400, 2.0)],  # type: ignore[arg-type]
)
def test_what_is_no_waypoint_is_rejected_here_already(pair: Pair, command: Any) -> None:
    tick(pair, 1, Reported(control=ControlReport(1, True, "", "")))
    goal = pair.end.ports[1].goto(command)
    assert answer(pair).asks == ()
    assert pair.heard[-1] == GoalReport(1, goal, "rejected")


def test_numbers_of_other_libraries_are_numbers(pair: Pair) -> None:
    tick(pair, 1, Reported(control=ControlReport(1, True, "", "")))
    pair.end.ports[1].goto(Waypoint(np.float64(1.5), 2, speed_m_s=np.float32(0.5)))  # type: ignore[arg-type]
    assert answer(pair).asks[0].target == Waypoint(1.5, 2.0, speed_m_s=0.5)


def test_of_what_is_announced_the_first_places_cross(pair: Pair) -> None:
    tick(pair, 1, Reported(control=ControlReport(1, True, "", "")))
    announced: Any = (*(Waypoint(float(x), 0.0) for x in range(100)), "home")
    pair.end.ports[1].goto(Waypoint(1.0, 1.0), announced)
    assert answer(pair).asks[0].upcoming == announced[:MAX_ANNOUNCED]


def test_a_turn_that_is_too_long_announces_nothing() -> None:
    pair = Pair()
    ids = tuple(range(1, 201))
    pair.supervisor.send(encode(Begin(5.0, 1.0, ids, (ROOM,) * len(ids))))
    pair.end.wait()
    tick(pair, 1, *(Reported(control=ControlReport(i, True, "", "")) for i in ids), states=tuple(state(i) for i in ids))
    for port in pair.end.ports.values():
        port.goto(Waypoint(1.5, 2.5), (Waypoint(2.5, 3.5),) * MAX_ANNOUNCED)
    sent = answer(pair, Turn(0, news=tuple(TargetGiven(i, 1, 1.5, 2.5) for i in ids)))
    assert len(sent.asks) == len(sent.news) == len(ids)
    assert all(ask.upcoming == () for ask in sent.asks)
    pair.close()


def test_a_supervisor_that_is_gone_ends_the_wait(pair: Pair) -> None:
    pair.supervisor.close()
    assert pair.end.wait() is None


def test_saying_what_hangs_never_waits(pair: Pair) -> None:
    for _ in range(10_000):
        pair.end.busy("Planner: Planner.Waiting")
    assert decode_up(pair.supervisor.recv(MAX_TURN_BYTES)) == Busy("Planner: Planner.Waiting")


def test_robots_of_other_processes_are_shown_and_take_nothing(pair: Pair) -> None:
    pair.supervisor.send(encode(Begin(5.0, 1.0, (1, 2), (ROOM, ROOM), peer_ids=(7,))))
    pair.end.wait()
    peers = (PeerSeen(state(7, 4.0), True),)
    pair.supervisor.send(encode(Tick(1, 5.0, 5.0, 1.0, (state(1), state(2)), (), peers)))
    pair.end.wait()
    assert set(pair.end.ports) == {1, 2}
    assert (pair.end.peers[7].state, pair.end.peers[7].engaged) == (state(7, 4.0), True)
    pair.end.peers[7].goto(Waypoint(1.0, 1.0))
    assert answer(pair).asks == ()
