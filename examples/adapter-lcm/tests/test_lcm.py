"""The adapter with real processes and a real bus; `soter conform lcm` tries all clauses of the kit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

pytest.importorskip("lcm")

from soter.conformance import CLAUSES as KIT
from soter.conformance import WIDE_ROOMS, Verdict, find_harness, judge
from soter.conformance.driver import drive_until
from soter.errors import RobotUnavailable
from soter.onboard.command import Command, GoalMessage, Report
from soter.onboard.wire import GateReport
from soter.sdk import Controller, GoalStatus, Waypoint
from soter_lcm.adapter import LcmBackend, LcmConfig
from soter_lcm.bus import Bus, free_url
from soter_lcm.harness import LcmHarness
from soter_lcm.types import report_t
from soter_lcm.wire import decode_command, decode_report, encode_command, encode_report

GOAL = GoalMessage(3, "AC", 1.0, 2.0, 0.0, 0.5, 0.1)
COMMAND = Command("me", 7, "AC", "first", 12.5, GOAL)
REPORT = Report(1, "first", 12.5, 1.0, 2.0, 0.7, 0.1, 0.2, 0.5, 0.75, GateReport("me", 7, "AC", True), 3)


@pytest.fixture
def harness() -> Iterator[LcmHarness]:
    opened = LcmHarness()
    yield opened
    opened.close()


def test_a_robot_goes_where_it_is_told_and_stops_when_the_link_is_cut(harness: LcmHarness) -> None:
    with harness.open(2) as fleet:
        robot, other = fleet.robots
        robot.init(10.0)
        other.init(10.0)
        start, far = robot.read_state(), other.read_state()
        goal = robot.goto(Waypoint(start.x_m - 0.2, start.y_m + 0.2), Controller.SC)
        assert drive_until(fleet, lambda: not goal.active, 20.0)
        assert goal.status is GoalStatus.REACHED
        robot.goto(Waypoint(start.x_m + 0.5, start.y_m), Controller.SC)
        assert drive_until(fleet, lambda: math.hypot(*robot.read_state()[7:9]) > 0.1, 10.0)
        harness.cut(robot.id)
        drive_until(fleet, lambda: False, 0.8)
        assert fleet.truth is not None
        stopped = fleet.truth.pose(robot.id)
        drive_until(fleet, lambda: False, 0.3)
        assert fleet.truth.pose(robot.id) == stopped
        assert other.read_state()[3:6] == pytest.approx(far[3:6])


@pytest.mark.parametrize("clause", ["truth.state.start", "goto.not_in_charge"])
def test_a_clause_of_the_kit_passes(clause: str) -> None:
    record = judge(find_harness("soter_lcm.adapter:LcmBackend"), [KIT[clause]])
    assert [(each.verdict, each.reason) for each in record.outcomes] == [(Verdict.PASS, "")]


def test_a_bus_that_is_closed_leaves_no_thread_and_no_socket() -> None:
    def held() -> tuple[int, int]:
        return len([*Path("/proc/self/task").iterdir()]), len([*Path("/proc/self/fd").iterdir()])

    def once() -> None:
        bus = Bus(free_url(), {"a": lambda _: None})
        bus.listen("test")
        bus.say("a", b"x")
        bus.close()

    once()
    before, times = held(), 10
    for _ in range(times):
        once()
    # A thread that has just ended may be listed for a moment longer; one that is left each time would add up.
    assert all(now < then + times // 2 for now, then in zip(held(), before, strict=True))


def test_a_message_arrives_and_after_the_end_none_is_said() -> None:
    heard: list[bytes] = []
    bus = Bus(free_url(), {"a": heard.append})
    for each in (b"1", b"2"):
        bus.say("a", each)
    while len(heard) < 2:
        bus.hear()
    bus.close()
    bus.say("a", b"3")
    assert heard == [b"1", b"2"]


def test_a_bus_that_cannot_be_opened_says_what_it_needs() -> None:
    with pytest.raises(RobotUnavailable, match="a route for multicast"):
        Bus("udpm://nowhere", {})


@pytest.mark.parametrize("url", ["udpm://239.255.76.67:7667?ttl=1", "udpm://239.255.76.67:7667", "tcpq://10.0.0.1:1"])
def test_buses_stay_on_this_host(url: str) -> None:
    with pytest.raises(ValidationError, match="allowed: udpm://"):
        LcmConfig.model_validate({"workspace": WIDE_ROOMS, "robots": {1: url}})


@pytest.mark.parametrize("command", [COMMAND, COMMAND._replace(goal=None, renewed_s=None)])
def test_commands_survive_the_wire(command: Command) -> None:
    assert decode_command(encode_command(command)) == command


@pytest.mark.parametrize("report", [REPORT, REPORT._replace(goal=None)])
def test_reports_survive_the_wire(report: Report) -> None:
    assert decode_report(encode_report(report)) == report


@given(st.binary(max_size=80), st.sampled_from([encode_command(COMMAND), encode_report(REPORT)]), st.integers(0, 200))
def test_rubbish_is_refused_as_such(rubbish: bytes, said: bytes, kept: int) -> None:
    for message in (rubbish, said[:kept], said[:kept] + rubbish):
        for decode in (decode_command, decode_report):
            with suppress(ValueError):
                decode(message)


@pytest.mark.parametrize("field", ["x_m", "stamp_s", "charge"])
def test_a_number_that_is_none_is_refused(field: str) -> None:
    said = report_t.decode(encode_report(REPORT))
    setattr(said, field, math.nan)
    with pytest.raises(ValueError, match="allowed: a number"):
        decode_report(said.encode())


def test_the_adapter_declares_what_its_robots_keep() -> None:
    from soter_sim.commanded import LEASE_S

    assert LcmBackend.robot_class.declared.lease_s == LEASE_S
