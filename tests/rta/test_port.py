"""The port: one slot, any thread, and nothing asked for without control ever moves anything."""

from __future__ import annotations

import itertools
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.rta import ControlReport, GoalReport, Port, Report
from soter.rta.port import MAX_UPCOMING


def make() -> tuple[Port[str, int], list[Report]]:
    reports: list[Report] = []
    return Port(7, reports.append), reports


def test_a_command_is_taken_once() -> None:
    port, reports = make()
    goal_id = port.goto("there", ("later",))
    request = port.take()
    assert request is not None
    assert (request.goal_id, request.command, request.upcoming) == (goal_id, "there", ("later",))
    assert port.take() is None
    assert reports == []


def test_a_newer_command_replaces_one_not_taken_and_its_owner_is_told() -> None:
    port, reports = make()
    first, second = port.goto("here"), port.goto("there")
    request = port.take()
    assert request is not None
    assert request.goal_id == second
    assert reports == [GoalReport(7, first, "superseded")]


def test_a_flood_from_many_threads_costs_one_slot_and_at_most_one_report() -> None:
    port, reports = make()
    ids: list[list[int]] = [[] for _ in range(8)]
    go = threading.Event()

    def flood(mine: list[int]) -> None:
        go.wait()
        mine.extend(port.goto(f"{len(mine)}") for _ in range(2000))

    threads = [threading.Thread(target=flood, args=(mine,)) for mine in ids]
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        for thread in threads:
            thread.start()
        go.set()
        taken = []
        while any(thread.is_alive() for thread in threads):
            if (request := port.take()) is not None:
                taken.append(request.goal_id)
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval_s)
    while (request := port.take()) is not None:
        taken.append(request.goal_id)
    given_out = sorted(goal_id for mine in ids for goal_id in mine)
    assert given_out == list(range(1, 16_001)), "every command has a number of its own"
    assert taken == sorted(set(taken)), "in the order of asking, none twice"
    assert taken[-1] == 16_000, "the last one is not lost"
    assert len(reports) <= len(taken)
    assert not {report.goal_id for report in reports if isinstance(report, GoalReport)} & set(taken)


def test_what_was_asked_for_without_control_is_refused() -> None:
    port, reports = make()
    goal_id = port.goto("there")
    port.refuse()
    assert port.take() is None
    assert reports == [GoalReport(7, goal_id, "rejected")]
    port.refuse()
    assert len(reports) == 1


def test_what_was_asked_for_between_the_last_look_and_regaining_control_is_refused() -> None:
    port, reports = make()
    port.refuse()
    goal_id = port.goto("there")
    port.control(True, "line", "")
    assert port.take() is None
    assert reports == [GoalReport(7, goal_id, "rejected"), ControlReport(7, True, "line", "")]


def test_control_is_reported_both_ways() -> None:
    port, reports = make()
    engaged = [port.engaged]
    port.control(True, "line", "")
    engaged.append(port.engaged)
    port.control(False, "line", "too near")
    engaged.append(port.engaged)
    assert engaged == [False, True, False]
    assert reports == [ControlReport(7, True, "line", ""), ControlReport(7, False, "line", "too near")]


@given(st.lists(st.sampled_from(["goto", "take", "refuse", "gain", "lose"]), max_size=40))
def test_every_command_is_taken_or_reported_as_ended_but_for_replaced_ones_in_a_flood(calls: list[str]) -> None:
    port, reports = make()
    asked, taken, in_slot = 0, [], None
    for call in calls:
        if call == "goto":
            asked += 1
            in_slot = port.goto("there")
            assert in_slot == asked
        elif call == "take":
            request = port.take()
            assert (None if request is None else request.goal_id) == in_slot
            if request is not None:
                taken.append(request.goal_id)
            in_slot = None
        elif call == "refuse":
            port.refuse()
            in_slot = None
        else:
            if call == "gain" and not port.engaged:
                in_slot = None
            port.control(call == "gain", "line", "")
    ended = [report.goal_id for report in reports if isinstance(report, GoalReport)]
    assert len(ended) == len(set(ended))
    assert not set(ended) & set(taken)


class Endless(tuple[str, ...]):
    """Intentions that never end."""

    __slots__ = ()

    def __iter__(self) -> Iterator[str]:
        return itertools.repeat("on")


@pytest.mark.parametrize("upcoming", [Endless(), None, 7, ["a", "b"]])
def test_intentions_that_are_no_plain_tuple_are_left_out(upcoming: Any) -> None:
    port: Port[str, None] = Port(1, lambda report: None)
    port.goto("there", upcoming)
    request = port.take()
    assert request is not None
    assert request.upcoming == ()


def test_only_so_many_intentions_are_kept() -> None:
    port: Port[str, None] = Port(1, lambda report: None)
    port.goto("there", ("on",) * (MAX_UPCOMING + 1))
    request = port.take()
    assert request is not None
    assert len(request.upcoming) == MAX_UPCOMING
