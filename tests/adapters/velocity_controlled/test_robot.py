"""A robot behind a mux without any wire: what it makes of what is heard, in a time that the test moves."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.velocity_controlled.robot import LEASE_S, VelocityControlledRobot
from soter.clock import VehicleClock
from soter.errors import Unsupported
from soter.onboard.wire import GateReport, Order
from soter.sdk import Capabilities, Controller, RobotSpec, Waypoint


class Host:
    """The host's time."""

    def __init__(self) -> None:
        self.now_s = 10.0

    def __call__(self) -> float:
        return self.now_s


class Fake(VelocityControlledRobot):
    """Keeps what it says; its mux takes every order at once."""

    def __init__(self, host: Host, promised: Capabilities | None = None, **options: Any) -> None:
        super().__init__(RobotSpec(1, 0.0, 0.0, 0.0, promised=promised), VehicleClock(steady=host), **options)
        self.host = host
        self.velocities: list[tuple[str, float, float]] = []
        self.orders: list[Order] = []
        self.has_mux = True

    def _connect(self, timeout_s: float) -> Capabilities:
        return self.declared

    def _send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float) -> None:
        self.velocities.append((by, forward_m_s, turn_rad_s))

    def _send_order(self, text: str) -> None:
        order = Order.decode(text)
        self.orders.append(order)
        if not self.has_mux:
            return
        self._take_report(GateReport(order.session, order.seq, order.controller, order.renewed_s is not None).encode())

    def hear(
        self,
        stamp_s: float,
        x_m: float = 0.0,
        percentage: float | None = 0.5,
        w: float = 1.0,
        forward_m_s: float = 0.0,
        turn_rad_s: float = 0.0,
    ) -> None:
        """Hear odometry, and of the battery unless its percentage is None."""
        stamp = SimpleNamespace(sec=math.floor(stamp_s), nanosec=round(stamp_s % 1.0 * 1e9))
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        if percentage is not None:
            self._take_battery(SimpleNamespace(header=SimpleNamespace(stamp=stamp), percentage=percentage))
        self._take_odometry(
            SimpleNamespace(
                header=SimpleNamespace(stamp=stamp),
                pose=SimpleNamespace(
                    pose=SimpleNamespace(
                        position=SimpleNamespace(**{**zero, "x": x_m}), orientation=SimpleNamespace(**zero, w=w)
                    )
                ),
                twist=SimpleNamespace(
                    twist=SimpleNamespace(
                        linear=SimpleNamespace(**{**zero, "x": forward_m_s}),
                        angular=SimpleNamespace(**{**zero, "z": turn_rad_s}),
                    )
                ),
            )
        )


@pytest.fixture
def robot() -> Fake:
    robot = Fake(Host())
    robot.hear(500.0)
    robot.init(1.0)
    return robot


def renewed(robot: Fake, until_s: float) -> Controller | None:
    """Renew the lease at every tick until a time of its clock; return who it says is in charge then."""
    while robot.host.now_s < until_s:
        robot.host.now_s += 0.05
        robot.renew_lease()
        robot.hear(490.0 + robot.host.now_s)
    return robot.read_state().controller


def test_a_mux_that_answers_no_more_says_nothing_of_who_is_in_charge(robot: Fake) -> None:
    assert renewed(robot, 12.0) is Controller.SC
    robot.has_mux = False
    assert renewed(robot, 12.9) is Controller.SC, "some orders may get lost"
    assert renewed(robot, 13.2) is None
    robot.has_mux = True
    assert renewed(robot, 13.3) is Controller.SC


def later(robot: Fake, seconds: float, clock_s: float, percentage: float | None = None) -> float | None:
    """Let time pass, hear odometry by a clock that is `clock_s` ahead by then, and return the charge."""
    for _ in range(10):
        robot.host.now_s += 0.1 * seconds
        robot.hear(490.0 + robot.host.now_s + clock_s, percentage=percentage)
    return robot.read_state().battery


@pytest.mark.parametrize("clock_s", [0.0, 3600.0, -30.0])
def test_between_two_reports_a_battery_is_taken_to_be_driving_whatever_its_clock_does(clock_s: float) -> None:
    robot = Fake(Host())
    robot.hear(500.0)
    robot.init(1.0)
    drive_s = robot.spec.drive_s
    assert later(robot, 10.0, 0.0) == pytest.approx(0.5 - 10.0 / drive_s)
    assert later(robot, 10.0, clock_s) == pytest.approx(0.5 - 20.0 / drive_s)
    assert later(robot, 1.0, clock_s, percentage=0.4) == 0.4
    assert later(robot, 2.0 * drive_s, clock_s) == 0.0


def test_a_charge_that_was_reported_before_the_robot_was_there_has_aged(robot: Fake) -> None:
    robot = Fake(Host())
    stamp = SimpleNamespace(sec=400, nanosec=0)
    robot._take_battery(SimpleNamespace(header=SimpleNamespace(stamp=stamp), percentage=0.5))
    robot.hear(500.0, percentage=None)
    robot.init(1.0)
    assert robot.read_state().battery == pytest.approx(0.5 - 100.0 / robot.spec.drive_s)


def test_a_report_on_its_way_while_the_clock_is_set_is_no_older_than_the_one_before(robot: Fake) -> None:
    later(robot, 1.0, 3600.0)
    stamp = SimpleNamespace(sec=501, nanosec=0)
    robot._take_battery(SimpleNamespace(header=SimpleNamespace(stamp=stamp), percentage=0.5))
    assert later(robot, 1.0, 3600.0) == pytest.approx(0.5 - 2.0 / robot.spec.drive_s)


def test_a_report_that_comes_late_has_aged_since_it_was_made(robot: Fake) -> None:
    later(robot, 100.0, 0.0, percentage=0.4)
    stamp = SimpleNamespace(sec=500, nanosec=0)
    robot._take_battery(SimpleNamespace(header=SimpleNamespace(stamp=stamp), percentage=0.5))
    assert later(robot, 1.0, 0.0) == pytest.approx(0.5 - 101.0 / robot.spec.drive_s)


def test_a_link_that_was_silent_is_no_dead_mux(robot: Fake) -> None:
    robot.has_mux = False
    renewed(robot, 10.5)
    robot.host.now_s = 30.0
    assert renewed(robot, 30.1) is Controller.SC


def test_a_robot_that_was_told_nothing_need_not_answer(robot: Fake) -> None:
    robot.has_mux = False
    for stamp_s in range(501, 520):
        robot.hear(float(stamp_s))
    assert robot.read_state().controller is Controller.SC


def test_it_steers_at_each_odometry_and_only_while_its_lease_lives(robot: Fake) -> None:
    robot.renew_lease()
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    sent = len(robot.velocities)
    assert robot.velocities[-1][0] == "SC"
    assert robot.velocities[-1][1] > 0.1
    robot.host.now_s += 0.9 * LEASE_S
    robot.hear(500.0 + 0.9 * LEASE_S)
    assert len(robot.velocities) == sent + 1
    robot.host.now_s += 0.1 * LEASE_S
    robot.hear(500.0 + LEASE_S)
    assert len(robot.velocities) == sent + 1


@pytest.mark.parametrize("turned", [0.0, math.pi])
def test_a_robot_whose_odometry_is_as_noisy_as_promised_drives(turned: float) -> None:
    """Fused odometry shows some speed where a robot stands: with less than that allowed, it would stand for ever."""
    robot = Fake(Host(), promised=replace(Fake.declared, speed_noise_m_s=0.03))
    robot.hear(500.0, forward_m_s=0.03)
    robot.init(1.0)
    robot.renew_lease()
    robot.goto(Waypoint(math.cos(turned), math.sin(turned)), Controller.SC)
    _, forward_m_s, turn_rad_s = robot.velocities[-1]
    assert forward_m_s > 0.1 or abs(turn_rad_s) > 0.5


def test_what_it_knows_of_too_long_ago_it_does_not_steer_by(robot: Fake) -> None:
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    robot.host.now_s += 0.4
    robot.renew_lease()
    robot.goto(Waypoint(2.0, 0.0), Controller.SC)
    assert robot.velocities[-1] == ("SC", 0.0, 0.0)


def test_a_change_of_hands_is_one_order_and_drops_the_target(robot: Fake) -> None:
    robot.renew_lease()
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    robot.switch_ac_sc(Controller.AC, "test")
    numbers = [order.seq for order in robot.orders]
    assert numbers == sorted(set(numbers))
    assert robot.orders[-1].controller == "AC"
    assert robot.orders[-1].renewed_s == pytest.approx(500.0)
    robot.host.now_s += 0.03
    robot.hear(500.03)
    assert robot.velocities[-1] == ("AC", 0.0, 0.0)
    assert robot.read_state().controller is Controller.AC


def test_what_a_mux_says_of_somebody_else_is_not_believed(robot: Fake) -> None:
    robot._take_report(GateReport("others", 9, "AC", alive=True).encode())
    robot.host.now_s += 0.03
    robot.hear(500.03)
    assert robot.read_state().controller is None


def test_a_program_whose_mux_follows_another_does_not_speak_for_its_controllers(robot: Fake) -> None:
    # It has been stopped for a while, and another one has taken its place; the mux would pass on what either says.
    robot.renew_lease()
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    robot._take_report(GateReport("another", 7, "SC", True).encode())
    sent = len(robot.velocities)
    robot.host.now_s += 0.03
    robot.hear(500.03)
    robot.goto(Waypoint(2.0, 0.0), Controller.SC)
    assert len(robot.velocities) == sent
    robot.renew_lease()  # which this mux takes, because the other one's lease is dead
    robot.host.now_s += 0.03
    robot.hear(500.06)
    assert len(robot.velocities) == sent + 1


def test_what_was_overtaken_on_its_way_is_left_out(robot: Fake) -> None:
    robot.host.now_s += 0.1
    robot.hear(500.1, x_m=0.1)
    robot.hear(500.05, x_m=0.05)
    assert robot.read_state().x_m == pytest.approx(0.1)
    assert robot.discarded == 0


def test_over_a_reboot_a_battery_that_is_silent_counts_as_driving(robot: Fake) -> None:
    for stamp_s in (3.0, 3.1, 3.2, 3.3, 3.4, 3.5, 3.6, 3.7, 3.8, 3.9):
        robot.host.now_s += 0.1
        robot.hear(stamp_s, percentage=None)
    robot.host.now_s += 60.0
    robot.hear(63.9, percentage=None)
    assert robot.read_state().battery == pytest.approx(0.5 - 61.0 / robot.spec.drive_s)


def test_what_makes_no_sense_is_counted_and_said_once(robot: Fake, caplog: pytest.LogCaptureFixture) -> None:
    for stamp_s in (500.1, 500.2, 500.3):
        robot.hear(stamp_s, x_m=math.nan, percentage=1.5)
        robot._take_report("{}")
    assert sorted(robot.dropped.values()) == [3, 3, 3]
    assert len(caplog.records) == 3
    state = robot.read_state()
    assert (state.x_m, state.battery) == (0.0, 0.5)


EXTREME = st.floats() | st.sampled_from([1e9, 1e300, -1.7e308, math.inf, math.nan])


@given(x_m=EXTREME, w=EXTREME, forward_m_s=EXTREME, turn_rad_s=EXTREME, percentage=EXTREME, text=st.text())
def test_whatever_is_heard_it_goes_on_hearing(
    x_m: float, w: float, forward_m_s: float, turn_rad_s: float, percentage: float, text: str
) -> None:
    robot = Fake(Host(), rate=100.0)
    robot.hear(500.0)
    robot.init(1.0)
    robot.renew_lease()
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    robot.host.now_s += 1e-3
    robot.hear(500.1, x_m, percentage, w, forward_m_s, turn_rad_s)
    robot._take_report(text)
    assert all(map(math.isfinite, (value for sent in robot.velocities for value in sent[1:])))
    assert all(map(math.isfinite, robot.read_state()[1:9]))
    robot.hear(500.2)
    assert robot.read_state().x_m == 0.0


def test_an_orientation_that_nobody_filled_in_is_none(robot: Fake) -> None:
    robot.host.now_s += 0.03
    robot.hear(500.03, x_m=0.1, w=0.0)
    assert robot.read_state().x_m == 0.0
    assert robot.dropped == {"odometry that is not finite": 1}
    robot.hear(500.03, x_m=0.1, w=0.5)
    assert robot.read_state().x_m == 0.1


def test_an_ac_that_is_somebody_elses_is_not_spoken_for() -> None:
    robot = Fake(Host(), external_ac=True)
    robot.hear(500.0)
    robot.init(1.0)
    robot.switch_ac_sc(Controller.AC, "test")
    robot.host.now_s += 0.03
    robot.hear(500.03)
    assert robot.velocities == []
    with pytest.raises(Unsupported, match="its AC is another program"):
        robot.goto(Waypoint(1.0, 0.0), Controller.AC)


def test_closing_ends_the_lease_and_waits_for_rest(robot: Fake) -> None:
    robot.renew_lease()
    robot.goto(Waypoint(1.0, 0.0), Controller.SC)
    robot.close(1.0)
    assert robot.orders[-1] == Order(robot.orders[0].session, robot.orders[-1].seq, "SC", None)
    sent = len(robot.velocities)
    robot.hear(500.01)
    assert len(robot.velocities) == sent


@pytest.mark.parametrize(("hears", "answers", "waits_s"), [(True, True, 5.0), (True, False, 1.0), (False, True, 1.0)])
def test_closing_waits_no_longer_than_a_second_for_a_robot_or_a_mux_that_is_gone(
    robot: Fake, monkeypatch: pytest.MonkeyPatch, hears: bool, answers: bool, waits_s: float
) -> None:
    def order(self: Fake, text: str) -> None:
        self.host.now_s += 0.05
        if answers:
            taken(self, text)
        if hears:
            self.hear(490.0 + self.host.now_s, forward_m_s=0.1)

    robot.hear(500.01, forward_m_s=0.1)  # at speed, and never seen at rest
    taken = Fake._send_order
    monkeypatch.setattr(Fake, "_send_order", order)
    monkeypatch.setattr("soter.adapters.velocity_controlled.robot.wait_for", lambda holds, _timeout_s: holds())
    began_s = robot.host.now_s
    robot.close(5.0)
    assert robot.host.now_s - began_s == pytest.approx(waits_s, abs=0.06)
