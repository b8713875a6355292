from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter_zmq.wire import LEASE_S, Command, GoalMessage, Report, compass_deg, heading_rad

GOAL = GoalMessage(3, "AC", 2.0, 1.0, 45.0, None)
COMMAND = Command("me", 7, 12.5, "AC", GOAL)
REPORT = Report(1, "first", "me", 7, 12.5, 2.0, 1.0, 45.0, 0.1, 0.1, -3.0, 80.0, "AC", 3)


def changed(message: bytes, **values: object) -> bytes:
    return json.dumps({**json.loads(message), **values}).encode()


@pytest.mark.parametrize(
    ("east_of_north", "from_east"),
    [(0.0, math.pi / 2), (90.0, 0.0), (180.0, -math.pi / 2), (270.0, math.pi), (45.0, math.pi / 4)],
)
def test_a_compass_turns_clockwise_from_north(east_of_north: float, from_east: float) -> None:
    assert heading_rad(east_of_north) == pytest.approx(from_east)
    assert compass_deg(from_east) == pytest.approx(east_of_north)


@given(st.floats(-math.pi, math.pi))
def test_headings_survive_the_wire(angle_rad: float) -> None:
    back = heading_rad(compass_deg(angle_rad))
    assert -math.pi < back <= math.pi
    assert math.remainder(back - angle_rad, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-1e9, 1e9))
def test_any_heading_comes_out_in_range(degrees: float) -> None:
    assert -math.pi < heading_rad(degrees) <= math.pi


@pytest.mark.parametrize("command", [COMMAND, COMMAND._replace(goal=None, lease_s=None)])
def test_commands_survive_the_wire(command: Command) -> None:
    assert Command.decode(command.encode()) == command


@pytest.mark.parametrize("report", [REPORT, REPORT._replace(goal=None)])
def test_reports_survive_the_wire(report: Report) -> None:
    assert Report.decode(report.encode()) == report


@pytest.mark.parametrize(
    "message",
    [
        b"", b"[]", b"\xff", b"{}", changed(COMMAND.encode(), lease_s=math.nan), changed(COMMAND.encode(), seq=True),
        changed(COMMAND.encode(), controller="ac"), changed(COMMAND.encode(), goal=[1, 2]),
        changed(COMMAND.encode(), goal={**GOAL._asdict(), "north_m": math.inf}),
        changed(COMMAND.encode(), goal={**GOAL._asdict(), "by": None}),
    ],
)  # fmt: skip
def test_a_command_that_makes_no_sense_is_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r"not an object|no number|allowed|Expecting|decode"):
        Command.decode(message)


@given(st.binary(max_size=60))
def test_rubbish_is_refused_as_such(message: bytes) -> None:
    for kind in (Command, Report):
        try:
            kind.decode(message)
        except ValueError:
            continue


def test_a_report_with_a_hole_is_refused() -> None:
    with pytest.raises(ValueError, match="heading_deg is None"):
        Report.decode(changed(REPORT.encode(), heading_deg=None))


def test_the_lease_is_what_the_adapter_declares() -> None:
    from soter_zmq.adapter import ZmqRobot

    assert ZmqRobot.declared.lease_s == LEASE_S
