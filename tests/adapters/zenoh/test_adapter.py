"""The adapter over real Zenoh, on loopback, against simulated robots in processes of their own."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import Any

import pytest
import zenoh

from soter.adapters.zenoh.backend import ZenohBackend
from soter.adapters.zenoh.messages import (
    BatteryState,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    String,
    Twist,
    Vector3,
)
from soter.adapters.zenoh.options import ZenohConfig
from soter.adapters.zenoh.session import SessionOptions, endpoints
from soter.adapters.zenoh.simulator import ZenohSimulator
from soter.adapters.zenoh.talk import Ear, Voice, stamp_of
from soter.errors import RobotUnavailable
from soter.onboard.wire import GateReport, Order
from soter.sdk import Controller, GoalStatus, Link, Waypoint
from soter.sdk.wire import WireFleet
from tests.adapters.velocity_controlled import behaviour
from tests.adapters.velocity_controlled.driving import PATIENT, ROOM, SPECS, rest_after_s, tick, under_way
from tests.adapters.zenoh.sessions import client, opened, router
from tests.waiting import wait_until

Open = Callable[..., WireFleet[Any]]


def test_with_no_robot_given_it_starts_its_own_and_ends_them() -> None:
    with ZenohBackend().open(ZenohConfig(workspace=ROOM, stamped=True), SPECS) as fleet:
        behaviour.drives(fleet)
        assert all(robot.wire.presence.there >= {"base", "mux"} for robot in fleet.robots)
        simulator = fleet.simulator
        assert simulator is not None
    assert simulator.world.returncode == 0
    assert [process.returncode for process in simulator.muxes.values()] == [0, 0]


def test_a_faster_world_is_driven_at_its_own_pace_and_promises_less() -> None:
    config = ZenohConfig(workspace=ROOM.with_robots(1), speedup=2.0)
    with ZenohBackend().open(config, SPECS[:1]) as fleet:
        robot = fleet.robots[0]
        robot.init(20.0)
        assert robot.capabilities == ZenohBackend.promises(config)
        assert robot.capabilities.latency_s == 2.0 * ZenohBackend.robot_class.declared.latency_s
        began_s, host_s = robot.read_state().vehicle_stamp_s, fleet.clock.steady_s()
        goal = robot.goto(Waypoint(2.3, 2.6), Controller.SC)
        assert tick(fleet, lambda: not goal.active, 20.0)
        assert goal.status is GoalStatus.REACHED
        # For some seconds more, of which the age of a sample is little.
        tick(fleet, lambda: False, 8.0)
        passed_s = robot.read_state().vehicle_stamp_s - began_s
        assert passed_s / (fleet.clock.steady_s() - host_s) == pytest.approx(2.0, rel=0.1)


# --- what is refused, and how it is said -------------------------------------------------------------------


def refusal(fleet: WireFleet[Any]) -> str:
    with pytest.raises(RobotUnavailable) as caught:
        fleet.robots[0].init(20.0)
    return str(caught.value)


def test_what_is_missing_is_listed(shared: ZenohSimulator, open_fleet: Open) -> None:
    text = refusal(open_fleet(shared, ready=False, robots={1: {"namespace": "nobody"}}, discovery_s=0.5))
    assert text.startswith("robot 1 at nobody: within 0.5 s: ")
    for missing in ("nothing was heard on nobody/odom", "nothing was heard on nobody/battery_state",
                    "nothing was heard on nobody/soter/gate", "no mux is announced below nobody"):  # fmt: skip
        assert missing in text
    assert "Is the robot running, with `soter zenoh-mux` beside it" in text


def test_what_has_another_type_is_named(shared: ZenohSimulator, open_fleet: Open) -> None:
    text = refusal(open_fleet(shared, ready=False, keys={"odom": "battery_state"}, discovery_s=1.5))
    assert "what came on robot1/battery_state was no Odometry" in text
    assert "the robot announces its base and mux" in text
    assert "soter/gate" not in text


def test_that_there_is_no_link_is_said_with_the_cause(shared: ZenohSimulator, open_fleet: Open) -> None:
    nowhere = SessionOptions(connect=("tcp/127.0.0.1:9",))
    text = refusal(open_fleet(shared, ready=False, session=nowhere, discovery_s=0.5))
    assert "no link to tcp/127.0.0.1:9: no program listens there; start it, or correct host and port" in text
    assert "nothing was heard" not in text


def test_a_robot_without_a_namespace_is_refused() -> None:
    config = ZenohConfig.model_validate({"workspace": ROOM, "robots": {"2": {"namespace": "robot2"}}})
    with pytest.raises(RobotUnavailable, match=r"no address is given for the robots \[1\]"):
        ZenohBackend().open(config, SPECS)


@contextmanager
def saying(session: zenoh.Session, key: str, message: Any) -> Iterator[None]:
    """Somebody says something again and again."""
    voice, done = Voice(session, key), threading.Event()

    def say() -> None:
        while not done.wait(0.05):
            voice.say_bytes(message) if isinstance(message, bytes) else voice.say(message)

    talking = threading.Thread(target=say)
    talking.start()
    try:
        yield
    finally:
        done.set()
        talking.join()


@pytest.mark.parametrize(
    ("key", "what"), [("cmd_vel", "drives it past the mux"), ("cmd_vel_sc", "in its safe controller's name")]
)
def test_whoever_can_go_round_the_mux_is_noticed(
    shared: ZenohSimulator, open_fleet: Open, somebody: zenoh.Session, key: str, what: str
) -> None:
    # Too slow to move it by much.
    forged = Twist(Vector3(x=0.001))
    with saying(somebody, f"robot1/{key}", forged):
        text = refusal(open_fleet(shared, ready=False))
    assert f"another program publishes velocities on robot1/{key}" in text
    assert what in text
    assert "let them publish it on robot1/cmd_vel_ac" in text


@pytest.mark.parametrize("key", ["cmd_vel", "cmd_vel_sc"])
def test_whoever_goes_round_the_mux_later_is_noticed_too(
    shared: ZenohSimulator, open_fleet: Open, somebody: zenoh.Session, key: str
) -> None:
    robot = open_fleet(shared).robots[0]

    assert not behaviour.intruder(robot)
    with saying(somebody, f"robot1/{key}", Twist(Vector3(x=0.001))):
        wait_until(lambda: f"robot1/{key}" in behaviour.intruder(robot))
    wait_until(lambda: not behaviour.intruder(robot))


def test_a_world_of_a_runs_own_lets_nobody_else_in() -> None:
    with ZenohBackend().open(ZenohConfig(workspace=ROOM.with_robots(1)), SPECS[:1]) as fleet:
        fleet.robots[0].init(20.0)
        simulator = fleet.simulator
        assert simulator is not None
        session = simulator.session
        assert session.password_file is not None
        assert session.password_file.parent.stat().st_mode & 0o077 == 0
        with opened(SessionOptions(connect=session.connect), session) as (stranger, friend):
            wait_until(lambda: bool(friend.info.links()))
            assert not stranger.info.links()
    assert not session.password_file.parent.exists()


def test_a_robot_that_follows_another_program_is_refused(open_fleet: Open) -> None:
    with (
        closing(ZenohSimulator(ROOM.with_robots(1), PATIENT)) as simulator,
        open_fleet(simulator, specs=PATIENT) as first,
        open_fleet(simulator, specs=PATIENT, ready=False) as other,
    ):
        behaviour.follows_another_program(first, other)


class Bridged:
    """A robot as zenoh-bridge-ros2dds shows it, with a mux of ROS, which says something only when it is told to."""

    def __init__(self, session: zenoh.Session) -> None:
        self.asked: list[Twist] = []
        self._gate = Voice(session, "hall/tb1/soter/gate")
        self._odometry, self._battery = Voice(session, "odometry/tb1"), Voice(session, "hall/tb1/battery_state")
        Ear(session, "hall/tb1/soter/order", String, self._obey)
        Ear(session, "hall/tb1/cmd_vel_sc", Twist, self.asked.append)

    def tell(self) -> None:
        """Say where it is, in the frame of its own odometry."""
        header = Header(stamp_of(time.time()))
        self._odometry.say(Odometry(header))
        self._battery.say(BatteryState(header, percentage=0.7))

    def _obey(self, message: String) -> None:
        order = Order.decode(message.data)
        self._gate.say(
            String(GateReport(order.session, order.seq, order.controller, order.renewed_s is not None).encode())
        )


def test_a_robot_of_ros_behind_a_bridge_is_found_placed_and_asked_for_velocities() -> None:
    with opened(SessionOptions()) as (session,):
        robot, done = Bridged(session), threading.Event()

        def live() -> None:
            while not done.wait(1.0 / 30.0):
                robot.tell()

        living = threading.Thread(target=live)
        living.start()
        try:
            config = ZenohConfig.model_validate({
                "workspace": ROOM.with_robots(1),
                "session": SessionOptions(connect=tuple(endpoints(session))),
                "keys": {"odom": "/odometry/tb1"},
                "robots": {"1": {"namespace": "hall/tb1", "odom_origin": (2.0, 2.5, 0.4)}},
            })  # fmt: skip
            with ZenohBackend().open(config, SPECS[:1]) as fleet:
                fleet.robots[0].init(10.0)
                state = fleet.robots[0].read_state()
                assert (state.x_m, state.y_m, state.heading_rad) == pytest.approx((2.0, 2.5, 0.4))
                assert state.battery == pytest.approx(0.7, abs=0.01)
                assert state.controller is Controller.SC
                assert fleet.truth is None
                ahead = Waypoint(2.0 + math.cos(0.4), 2.5 + math.sin(0.4))
                fleet.robots[0].goto(ahead, Controller.SC)
                assert tick(fleet, lambda: any(each.linear.x > 0.1 for each in robot.asked), 5.0)
        finally:
            done.set()
            living.join()


# --- what others send ------------------------------------------------------------------------------------------------


def test_garbage_is_counted_and_changes_nothing(
    shared: ZenohSimulator, open_fleet: Open, somebody: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    fleet = open_fleet(shared)
    robot = fleet.robots[0]
    ears = robot.wire.ears
    with saying(somebody, "robot1/odom", b"\x00\x01\x00\x00garbage"), saying(somebody, "robot1/soter/gate", b""):
        assert tick(fleet, lambda: ears["odom"].foreign > 5 and ears["gate"].foreign > 5, 10.0)
    assert robot.read_state().link is Link.UP
    assert robot.discarded == 0
    told = [each.getMessage() for each in caplog.records]
    assert len([each for each in told if "robot1/odom: dropped what is no Odometry" in each]) == 1
    # The mux and the base get the like, and go on.
    with saying(somebody, "robot1/soter/order", b"\xff"), saying(somebody, "robot1/cmd_vel_sc", String("go")):
        goal = robot.goto(Waypoint(2.2, 2.55), Controller.SC)
        assert tick(fleet, lambda: not goal.active, 20.0)
    assert goal.status is GoalStatus.REACHED


def test_numbers_that_cannot_be_meant_are_dropped(
    shared: ZenohSimulator, open_fleet: Open, somebody: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    fleet = open_fleet(shared)
    robot = fleet.robots[0]
    nowhere = Odometry(Header(stamp_of(2000.0)), pose=PoseWithCovariance(Pose(Point(math.nan))))
    with (
        saying(somebody, "robot1/odom", nowhere),
        saying(somebody, "robot1/soter/gate", String('{"seq": 1, "controller": "both"}')),
    ):
        assert tick(fleet, lambda: "a report of its mux that makes no sense" in caplog.text, 10.0)
        assert tick(fleet, lambda: "dropped odometry that is not finite" in caplog.text, 10.0)
    state = robot.read_state()
    assert math.isfinite(state.x_m)
    assert state.link is Link.UP
    assert robot.discarded == 0
    assert robot.dropped["odometry that is not finite"] > 0
    assert caplog.text.count("dropped odometry that is not finite") == 1


# --- what stops what ---------------------------------------------------------------------------------------


def test_when_soter_falls_silent_the_robot_stops(shared: ZenohSimulator, open_fleet: Open) -> None:
    behaviour.silence(open_fleet(shared))


def test_when_its_mux_dies_the_robot_stops_and_goes_on_with_the_next(
    simulator: ZenohSimulator, open_fleet: Open, caplog: pytest.LogCaptureFixture
) -> None:
    behaviour.mux_dies(open_fleet(simulator), simulator)
    assert "robot1: its mux has gone, or the link to it" in caplog.text


def test_when_the_robot_dies_its_link_goes_down_and_closing_does_not_hang(
    simulator: ZenohSimulator, open_fleet: Open
) -> None:
    behaviour.robot_dies(open_fleet(simulator), simulator)


def test_a_robot_that_was_switched_off_and_on_again_works_without_a_restart(
    simulator: ZenohSimulator, open_fleet: Open
) -> None:
    def start_again() -> ZenohSimulator:
        return ZenohSimulator(ROOM.with_robots(1), SPECS[:1], SessionOptions(listen=simulator.session.connect))

    behaviour.robot_reboots(open_fleet(simulator, truth=None), simulator, start_again, on_s=5.0)


def test_when_the_router_dies_robots_stop_and_go_on_with_the_next(open_fleet: Open) -> None:
    with ExitStack() as simulated:
        with router() as where:
            simulator = ZenohSimulator(ROOM.with_robots(1), SPECS[:1], client(where))
            simulated.callback(simulator.close)
            fleet = open_fleet(simulator)
            robot = fleet.robots[0]
            under_way(fleet)
        assert rest_after_s(fleet, 2.0, drive=True) <= 0.15 + 0.22 + 0.3
        assert robot.read_state().link is Link.STALE
        with router(listen=where):
            assert tick(fleet, lambda: robot.read_state().link is Link.UP, 10.0)
            state = robot.read_state()
            goal = robot.goto(Waypoint(state.x_m + 0.1, state.y_m + 0.05), Controller.SC)
            assert tick(fleet, lambda: not goal.active, 20.0)
            assert goal.status is GoalStatus.REACHED
            fleet.close()
