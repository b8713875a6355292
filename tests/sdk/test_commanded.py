"""A robot that drives to goals by itself, without any wire: what its adapter says and makes of what it hears."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.geometry.workspace import Workspace
from soter.onboard.command import Command, GoalMessage, Report
from soter.onboard.wire import GateReport
from soter.sdk import Capabilities, Controller, GoalStatus, RobotSpec, Waypoint
from soter.sdk.commanded import SETTLED, CommandedRobot
from soter_sim import World
from soter_sim.commanded import CommandedVehicle
from soter_sim.kinematic import KinematicEngine

AC, SC = Controller.AC, Controller.SC
SPEC = RobotSpec(1, 1.0, 1.0, 0.0)
PERIOD_S = 0.02


class Rig(CommandedRobot):
    """A robot and its vehicle, in a time that the test moves; what it says arrives at once, while nothing is cut."""

    declared = Capabilities(
        in_process=False, deterministic=False, reverses=True, reports_battery=True, reports_controller=True,
        v_max_m_s=0.22, yaw_rate_max_rad_s=2.84, brake_m_s2=1.0, body_radius_m=0.105, latency_s=0.04,
        sample_age_s=0.07, jitter_s=0.03, setpoint_period_s=0.02, lease_s=0.15, tube_m=0.02, overshoot_m=0.01,
        position_noise_m=0.001, pivots_first=True,
    )  # fmt: skip

    def __init__(self) -> None:
        self.host_s = 100.0
        super().__init__(SPEC, VehicleClock(steady=lambda: self.host_s, sleep=lambda _: None))
        self.world = World(Workspace(4.0, 4.0, (), ()), [SPEC], partial(KinematicEngine, step_s=PERIOD_S))
        self.vehicle = CommandedVehicle(self.world, 1)
        self.changed: Callable[[Report], Report] = lambda report: report
        self.said: list[Command] = []
        self.cut = self.released = False
        self.settling = True

    def step(self, seconds: float = PERIOD_S) -> None:
        for _ in range(max(1, round(seconds / PERIOD_S))):
            self.host_s += PERIOD_S
            self.world.advance(self.host_s - 100.0)
            if not self.cut:
                self.receive(self.changed(self.vehicle.report()).encode())

    def _publish(self, message: bytes) -> None:
        self.said.append(Command.decode(message))
        if not self.cut:
            self.vehicle.take(self.said[-1])
        if self.settling:
            # Whoever waits for reports is given some, and finds that time passes.
            self.step(SETTLED * PERIOD_S)

    def _release(self) -> None:
        self.released = True


@pytest.fixture
def robot() -> Rig:
    rig = Rig()
    rig.init(5.0)
    rig.settling = False
    rig.step()
    return rig


def test_every_call_says_the_whole_under_a_new_number(robot: Rig) -> None:
    robot.renew_lease()
    robot.goto(Waypoint(2.0, 1.0, heading_rad=0.5, speed_m_s=0.1), SC)
    robot.switch_ac_sc(AC, "test")
    goal = robot.goto(Waypoint(1.5, 1.2), AC)
    numbers = [each.seq for each in robot.said]
    assert numbers == sorted(set(numbers))
    assert len({each.session for each in robot.said}) == 1
    last = robot.said[-1]
    assert (last.controller, last.goal) == ("AC", GoalMessage(goal.id, "AC", 1.5, 1.2))
    goal.cancel()
    assert robot.said[-1].goal is None


def test_only_a_renewal_renews(robot: Rig) -> None:
    robot.switch_ac_sc(AC, "test")
    renewed_s = robot.said[-1].renewed_s
    assert renewed_s is not None
    robot.step(0.1)
    goal = robot.goto(Waypoint(2.0, 1.0), AC)
    goal.cancel()
    robot.hand_over_again()
    assert {each.renewed_s for each in robot.said[-3:]} == {renewed_s}
    robot.renew_lease()
    assert robot.said[-1].renewed_s == pytest.approx(1000.0 + robot.world.now_s)
    assert robot.said[-1].renewed_s != renewed_s


def test_it_arrives_and_says_so(robot: Rig) -> None:
    goal = robot.goto(Waypoint(1.3, 1.1), SC)
    for _ in range(200):
        robot.renew_lease()
        robot.step(0.05)
        robot.read_state()
        if not goal.active:
            break
    assert goal.status is GoalStatus.REACHED
    state = robot.read_state()
    assert (state.controller, state.goal_id) == (SC, goal.id)
    assert state.battery == pytest.approx(1.0, abs=0.01)
    assert state.age_s(robot.clock.now()) == pytest.approx(0.0, abs=0.01)


def test_without_renewal_it_stands(robot: Rig) -> None:
    robot.goto(Waypoint(2.0, 1.0), SC)
    robot.renew_lease()
    robot.step(0.12)
    assert robot.world.bodies.v[0] > 0.0
    robot.step(1.0)
    assert robot.world.bodies.v[0] == 0.0


def test_what_is_late_renews_nothing(robot: Rig) -> None:
    robot.goto(Waypoint(2.0, 1.0), SC)
    robot.renew_lease()
    late = robot.said[-1]._replace(seq=robot.said[-1].seq + 1)
    robot.step(1.0)
    robot.vehicle.take(late)
    robot.step(0.1)
    assert robot.world.bodies.v[0] == 0.0


def test_what_makes_no_sense_or_is_anothers_is_dropped(robot: Rig, caplog: pytest.LogCaptureFixture) -> None:
    before = robot.read_state()
    with caplog.at_level(logging.WARNING):
        for message in (b"", b"{}", b"\xff", robot.vehicle.report()._replace(robot=2).encode()):
            robot.receive(message)
    assert robot.read_state() == before
    assert len(caplog.records) == 1, "one line, however many there are"


class Careless(Rig):
    """Decodes what has a place only; of all else it raises whatever Python does."""

    def _decode(self, message: bytes) -> Report:
        round(json.loads(message)["x_m"], 9)
        return super()._decode(message)


@pytest.mark.parametrize("edit", [{"x_m": None}, {"x_m": []}])
def test_whatever_decoding_raises_costs_that_message_only(
    edit: dict[str, object], caplog: pytest.LogCaptureFixture
) -> None:
    robot = Careless()
    robot.init(5.0)
    before = robot.read_state()
    said = json.loads(robot.vehicle.report().encode())
    with caplog.at_level(logging.WARNING):
        for message in (json.dumps({**said, **edit}), "{}", "[]", "null"):
            robot.receive(message.encode())
    assert robot.read_state() == before
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    robot.step(0.1)
    assert robot.read_state().stamp_s > before.stamp_s


def test_a_hand_over_sent_again_keeps_the_goal_and_one_to_the_other_does_not(robot: Rig) -> None:
    goal = robot.goto(Waypoint(2.0, 1.0), SC)
    robot.hand_over_again()
    again = robot.said[-1].goal
    assert again is not None
    assert again.id == goal.id
    robot.switch_ac_sc(AC, "test")
    assert robot.said[-1].goal is None


def test_a_report_that_was_overtaken_is_not_believed(robot: Rig) -> None:
    old = robot.vehicle.report()
    robot.step(0.2)
    before = robot.read_state()
    robot.receive(old.encode())
    assert robot.read_state() == before


def test_a_clock_that_began_anew_is_learned_before_anything_is_believed(robot: Rig) -> None:
    """The first report may have been long on its way: until the clock is known, samples grow old."""
    robot.changed = lambda report: report._replace(clock="new", stamp_s=report.stamp_s - 900.0)
    before = robot.read_state()
    robot.step((SETTLED - 1) * PERIOD_S)
    assert robot.read_state().stamp_s == before.stamp_s
    robot.step(2 * PERIOD_S)
    assert robot.read_state().age_s(robot.clock.now()) == pytest.approx(0.0, abs=0.01)
    robot.renew_lease()
    assert robot.said[-1].clock == "new"
    assert robot.said[-1].renewed_s == pytest.approx(100.0 + robot.world.now_s)


def test_a_lease_is_renewed_at_every_moment_of_a_restart(robot: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who hears the robot is another thread than who renews, and may be anywhere when that comes."""
    renewed = 0
    for name in ("observe", "forget"):
        original = getattr(VehicleClock, name)

        def then_renew(*given: Any, original: Any = original, **named: Any) -> object:
            nonlocal renewed
            found: object = original(*given, **named)
            robot.renew_lease()
            renewed += 1
            return found

        monkeypatch.setattr(VehicleClock, name, then_renew)
    robot.changed = lambda report: report._replace(clock="another", stamp_s=report.stamp_s - 5.0)
    robot.step(0.2)
    assert renewed >= 10


def test_closing_ends_the_lease_and_waits_until_the_robot_stands(robot: Rig) -> None:
    robot.goto(Waypoint(2.0, 1.0), SC)
    robot.renew_lease()
    robot.step(0.12)
    robot.settling = True
    robot.close(5.0)
    assert (robot.said[-1].controller, robot.said[-1].renewed_s, robot.said[-1].goal) == ("SC", None, None)
    assert robot.world.bodies.v[0] == 0.0
    assert robot.released


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (lambda each: each._replace(gate=GateReport("other", 7, "SC", True)), "it follows another program"),
        (lambda each: each._replace(gate=GateReport("other", 7, "SC", False)), "takes no command"),
        (lambda each: each._replace(vx_m_s=0.1), r"reports 0.100 m/s and .*promise\.speed_noise_m_s = None"),
        (lambda each: each._replace(yaw_rate_rad_s=0.2), r"reports 0.000 m/s and 0.200 rad/s.*speed_noise_m_s = None"),
        (lambda each: each._replace(gate=each.gate._replace(seq=1000)), "another program commands it under the same"),
        (lambda each: each._replace(robot=2), r"0 reports were heard within 1 s; is its process running"),
    ],
)
def test_a_robot_that_cannot_be_had_says_why(changed: Callable[[Report], Report], why: str) -> None:
    robot = Rig()
    robot.changed = changed
    with pytest.raises(RobotUnavailable, match=why):
        robot.init(1.0)
    robot.close(1.0)
    assert robot.released


def test_messages_that_cannot_be_decoded_are_counted_and_told_with_the_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def decode(self: Rig, message: bytes) -> Report:
        return Report.decode(mesage)  # type: ignore[name-defined]  # noqa: F821 - what a user has got wrong

    monkeypatch.setattr(Rig, "_decode", decode)
    robot = Rig()
    with pytest.raises(RobotUnavailable) as refusal:
        robot.init(1.0)
    where = f"(test_commanded.py, line {decode.__code__.co_firstlineno + 1})"
    found = re.search(r"(\d+) messages came within 1 s, and none could be decoded", str(refusal.value))
    assert found is not None
    assert int(found[1]) >= 10
    assert "NameError" in str(refusal.value)
    assert where in str(refusal.value)
    assert "address" not in str(refusal.value)
    assert [where in line for line in caplog.messages] == [True]
    robot.close(1.0)


def test_a_robot_that_seems_to_move_as_its_noise_has_it_is_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Rig, "declared", replace(Rig.declared, speed_noise_m_s=0.03))
    robot = Rig()
    robot.changed = lambda each: each._replace(vx_m_s=each.vx_m_s + 0.03, yaw_rate_rad_s=0.2)
    robot.init(1.0)
    robot.close(1.0)
    assert robot.host_s < 101.0, "nobody waited"


def test_what_another_program_is_told_under_the_same_name_is_not_taken_for_ones_own(robot: Rig) -> None:
    assert robot.read_state().controller is SC
    robot.changed = lambda each: each._replace(gate=each.gate._replace(seq=robot.said[-1].seq + 1))
    robot.step()
    state = robot.read_state()
    assert (state.controller, state.goal_id) == (None, None)


def test_a_robot_that_is_gone_is_not_waited_for_long(robot: Rig) -> None:
    robot.cut = True
    robot.step(2.0)
    robot.settling = True
    began_s = robot.host_s
    robot.close(60.0)
    assert robot.host_s - began_s < 2.0


numbers = st.floats(-1e6, 1e6)
goals = st.none() | st.builds(
    GoalMessage, st.integers(0, 99), st.sampled_from(["AC", "SC"]), numbers, numbers, numbers, st.none() | numbers,
    st.none() | numbers,
)  # fmt: skip
commands = st.builds(
    Command, st.text(max_size=20), st.integers(0, 2**53), st.sampled_from(["AC", "SC"]), st.text(max_size=20),
    st.none() | numbers, goals,
)  # fmt: skip


@given(commands)
def test_commands_survive_their_json(command: Command) -> None:
    assert Command.decode(command.encode()) == command


def test_reports_survive_their_json(robot: Rig) -> None:
    report = robot.vehicle.report()
    for each in (report, report._replace(battery=None, goal=3, z_m=1.0, vz_m_s=0.1)):
        assert Report.decode(each.encode()) == each


@given(st.binary(max_size=80))
def test_rubbish_is_refused_as_such(message: bytes) -> None:
    for decode in (Command.decode, Report.decode):
        with pytest.raises(ValueError, match=r"\w"):
            decode(message)
