from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.onboard.command import Command, GoalMessage, Report
from soter.onboard.wire import GateReport
from soter_zmq.wire import compass_deg, decode_command, decode_report, encode_command, encode_report, heading_rad

GOAL = GoalMessage(3, "AC", 1.0, 2.0, 0.0, math.pi / 4)
COMMAND = Command("me", 7, "AC", "first", 12.5, GOAL)
SAID = encode_command(COMMAND)
REPORT = Report(1, "first", 12.5, 1.0, 2.0, math.pi / 4, 0.1, 0.2, 0.5, 0.75, GateReport("me", 7, "AC", True), 3)


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


@pytest.mark.parametrize("command", [COMMAND, COMMAND._replace(goal=None, renewed_s=None)])
def test_commands_survive_the_wire(command: Command) -> None:
    assert decode_command(encode_command(command)) == command


@pytest.mark.parametrize("report", [REPORT, REPORT._replace(goal=None)])
def test_reports_survive_the_wire(report: Report) -> None:
    back = decode_report(encode_report(report))
    assert back._replace(heading_rad=0.0, yaw_rate_rad_s=0.0) == report._replace(heading_rad=0.0, yaw_rate_rad_s=0.0)
    assert (back.heading_rad, back.yaw_rate_rad_s) == pytest.approx((report.heading_rad, report.yaw_rate_rad_s))


def test_robots_say_north_first_and_turn_clockwise() -> None:
    said = json.loads(encode_report(REPORT))
    assert (said["north_m"], said["east_m"], said["heading_deg"]) == pytest.approx((2.0, 1.0, 45.0))
    assert (said["north_m_s"], said["east_m_s"], said["turn_deg_s"]) == pytest.approx((0.2, 0.1, -math.degrees(0.5)))
    assert said["charge_percent"] == 75.0
    goal = json.loads(encode_command(COMMAND))["goal"]
    assert (goal["north_m"], goal["east_m"], goal["heading_deg"]) == pytest.approx((2.0, 1.0, 45.0))


@pytest.mark.parametrize(
    "message",
    [
        b"", b"[]", b"\xff", b"{}", changed(SAID, lease_s=math.nan), changed(SAID, seq=True),
        changed(SAID, controller="ac"), changed(SAID, goal=[1, 2]),
        changed(SAID, goal={"id": 1, "by": "AC", "east_m": 1.0, "north_m": math.inf}),
        changed(SAID, goal={"id": 1, "by": None, "east_m": 1.0, "north_m": 1.0}),
    ],
)  # fmt: skip
def test_a_command_that_makes_no_sense_is_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r"not an object|allowed|Expecting|decode"):
        decode_command(message)


@given(st.binary(max_size=60))
def test_rubbish_is_refused_as_such(message: bytes) -> None:
    for decode in (decode_command, decode_report):
        try:
            decode(message)
        except ValueError:
            continue


def test_a_report_with_a_hole_is_refused() -> None:
    with pytest.raises(ValueError, match="heading_deg is None"):
        decode_report(changed(encode_report(REPORT), heading_deg=None))


def test_the_lease_is_what_the_adapter_declares() -> None:
    from soter_sim.commanded import LEASE_S
    from soter_zmq.adapter import ZmqRobot

    assert ZmqRobot.declared.lease_s == LEASE_S
