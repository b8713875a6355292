"""The adapter with real processes and a real wire. Bounds are wide: the machine may have other things to do."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import pytest
from pydantic import ValidationError

from soter.conformance.driver import drive_until
from soter.errors import RobotUnavailable
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import load_backend
from soter.sdk import Controller, Fleet, GoalStatus, Link, Robot, RobotSpec, Waypoint
from soter.sdk.wire import Simulator
from soter_sim.commanded import LEASE_S
from soter_zmq.adapter import ZmqBackend, ZmqConfig
from soter_zmq.harness import ZmqHarness

AC, SC = Controller.AC, Controller.SC
ROOM = Workspace(6.0, 5.0, (), (RobotPlace(1, 2.0, 3.0, Box(1.9, 2.9, 2.1, 3.1)),))
SPEC = RobotSpec(1, 2.0, 3.0, 0.7, 0.5)


@pytest.fixture
def harness() -> Iterator[ZmqHarness]:
    opened = ZmqHarness()
    yield opened
    opened.close()


def simulated(at: Mapping[int, Any] | None = None) -> Simulator:
    return Simulator("soter_zmq.robot", ROOM, [SPEC], at=at)


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    started = simulated()
    yield started
    started.close()


def given(simulator: Simulator) -> ZmqConfig:
    return ZmqConfig.model_validate({"workspace": ROOM, "robots": simulator.robots, "truth": simulator.truth})


def ready(fleet: Fleet) -> Robot:
    for robot in fleet.robots:
        robot.init(5.0)
    return fleet.robots[0]


def tick(fleet: Fleet, until: Callable[[], bool], limit_s: float = 10.0, *, renew: bool = True) -> bool:
    return drive_until(fleet, until, limit_s, renew=renew)


def speed(robot: Robot) -> float:
    state = robot.read_state()
    return math.hypot(state.vx_m_s, state.vy_m_s)


def really(fleet: Fleet, place: int = 0) -> tuple[float, float, float]:
    assert fleet.truth is not None
    return fleet.truth.pose(fleet.robots[place].id)


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_a_robot_is_where_it_says_and_goes_where_it_is_told(harness: ZmqHarness) -> None:
    with harness.open(2) as fleet:
        robot = ready(fleet)
        state = robot.read_state()
        assert (state.x_m, state.y_m, state.heading_rad) == pytest.approx((142.5, 73.5, 0.7))
        assert (state.controller, state.link) == (SC, Link.UP)
        assert state.battery == pytest.approx(0.1, abs=0.01)
        goal = robot.goto(Waypoint(142.1, 73.9), SC)
        assert tick(fleet, lambda: not goal.active)
        assert goal.status is GoalStatus.REACHED
        assert tick(fleet, lambda: speed(robot) < 1e-3)
        assert math.dist(really(fleet)[:2], (142.1, 73.9)) <= 0.02
        state = robot.read_state()
        assert (state.x_m, state.y_m, state.heading_rad) == pytest.approx(really(fleet), abs=0.01)
        assert really(fleet, 1) == pytest.approx((146.5, 74.2, -2.1))
        assert fleet.truth is not None
        assert fleet.truth.report().violations == ()


def test_no_call_waits_for_the_robot(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = ready(fleet)
        harness.cut(fleet.robots[0].id)
        took = []
        for turn in range(50):
            began_s = time.perf_counter()
            robot.switch_ac_sc((AC, SC)[turn % 2], "test")
            robot.goto(Waypoint(142.0, 73.0), (AC, SC)[turn % 2])
            robot.read_state()
            robot.renew_lease()
            took.append(time.perf_counter() - began_s)
        harness.restore(fleet.robots[0].id)
        assert sorted(took)[25] < 0.005


def test_a_switch_is_confirmed_by_the_robot_and_stops_what_the_other_had(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = ready(fleet)
        robot.switch_ac_sc(AC, "test")
        goal = robot.goto(Waypoint(143.3, 74.1), AC)
        assert tick(fleet, lambda: speed(robot) > 0.2)
        switch = robot.switch_ac_sc(SC, "test")
        assert goal.status is GoalStatus.PREEMPTED
        assert robot.goto(Waypoint(141.5, 73.0), AC).status is GoalStatus.REJECTED
        assert tick(fleet, lambda: speed(robot) < 1e-3 and switch.confirmed_s is not None)
        assert robot.read_state().goal_id is None


def test_without_renewal_the_robot_stops(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = ready(fleet)
        robot.goto(Waypoint(143.3, 74.1), SC)
        assert tick(fleet, lambda: speed(robot) > 0.2)
        assert tick(fleet, lambda: speed(robot) < 1e-3, 2.0, renew=False)
        assert tick(fleet, lambda: speed(robot) > 0.2)


def test_a_link_that_is_lost_stops_the_robot_and_comes_back(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = ready(fleet)
        robot.goto(Waypoint(143.3, 74.1), SC)
        assert tick(fleet, lambda: speed(robot) > 0.2)
        harness.cut(fleet.robots[0].id)
        assert tick(fleet, lambda: robot.read_state().link is Link.STALE)
        assert tick(fleet, lambda: robot.read_state().link is Link.DOWN)
        stopped = really(fleet)
        tick(fleet, lambda: False, 0.5)
        assert really(fleet) == stopped
        harness.restore(fleet.robots[0].id)
        assert tick(fleet, lambda: robot.read_state().link is Link.UP and speed(robot) > 0.2)


def test_what_was_late_renews_no_lease(harness: ZmqHarness) -> None:
    """Everything arrives, half a second late: the robot must not move on leases that are dead already."""
    with harness.open(1) as fleet:
        robot = ready(fleet)
        harness.delay(0.5)
        robot.goto(Waypoint(143.3, 74.1), SC)
        assert not tick(fleet, lambda: math.dist(really(fleet)[:2], (142.5, 73.5)) > 0.02, 2.0)
        assert robot.read_state().age_s(fleet.clock.now()) > 0.4
        harness.delay(0.0)
        assert tick(fleet, lambda: speed(robot) > 0.2)


def test_a_bad_link_loses_time_but_not_the_goal(harness: ZmqHarness) -> None:
    with harness.open(1) as fleet:
        robot = ready(fleet)
        harness.loss(0.3)
        harness.duplicate(0.3)
        harness.reorder(0.3)
        goal = robot.goto(Waypoint(142.1, 73.9), SC)
        assert tick(fleet, lambda: not goal.active, 20.0)
        assert goal.status is GoalStatus.REACHED


def test_a_robot_that_reboots_is_found_again(simulator: Simulator) -> None:
    with ExitStack() as stack:
        fleet = ZmqBackend().open(given(simulator), [SPEC])
        stack.callback(fleet.close)
        robot = ready(fleet)
        simulator.process.kill()
        simulator.process.wait()
        tick(fleet, lambda: robot.read_state().link is Link.STALE)
        again = simulated(simulator.robots)
        stack.pop_all()
        stack.callback(again.close)
        stack.callback(fleet.close)
        assert tick(fleet, lambda: robot.read_state().link is Link.UP)
        robot.goto(Waypoint(142.5, 73.4), SC)
        assert tick(fleet, lambda: speed(robot) > 0.2)


def test_nobody_takes_a_robot_from_who_commands_it(simulator: Simulator) -> None:
    refused: list[str] = []
    while not refused:
        renewed_s = [time.perf_counter()]
        with ZmqBackend().open(given(simulator), [SPEC]) as fleet, ZmqBackend().open(given(simulator), [SPEC]) as other:
            robot = ready(fleet)

            def take(taker: Robot = other.robots[0]) -> None:
                try:
                    taker.init(1.0)
                except RobotUnavailable as failure:
                    refused.append(str(failure))

            thread = threading.Thread(target=take)

            def over(taking: threading.Thread = thread, renewed_s: list[float] = renewed_s) -> bool:
                renewed_s.append(time.perf_counter())
                return not taking.is_alive()

            thread.start()
            try:
                robot.goto(Waypoint(142.5, 73.4), SC)
                assert tick(fleet, over)
            finally:
                thread.join()
            assert not refused or robot.read_state().controller is SC
        # Where a busy host let the lease run out the robot was nobody's, and anybody might take it.
        assert refused or max(after - before for before, after in pairwise(renewed_s)) > LEASE_S / 2
    assert "follows another program" in refused[0]


def test_closing_stops_the_robots_and_ends_their_process() -> None:
    with ZmqBackend().open(ZmqConfig(workspace=ROOM), [SPEC]) as fleet:
        robot = ready(fleet)
        robot.goto(Waypoint(143.0, 73.8), SC)
        assert tick(fleet, lambda: speed(robot) > 0.2)
        assert fleet.simulator is not None
        process = fleet.simulator.process
        robot.close(3.0)
        # The robot's word and the truth come on different sockets, one of them a moment later.
        fleet.clock.sleep_until(fleet.clock.now() + 0.1)
        here = really(fleet)
        fleet.clock.sleep_until(fleet.clock.now() + 0.2)
        assert really(fleet) == here
        assert process.poll() is None
        fleet.close()
        assert process.poll() is not None


def test_when_the_simulator_dies_nobody_waits_long_and_its_silence_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with ZmqBackend().open(ZmqConfig(workspace=ROOM), [SPEC]) as fleet:
        robot = ready(fleet)
        assert fleet.simulator is not None
        assert fleet.truth is not None
        fleet.simulator.process.kill()
        assert tick(fleet, lambda: robot.read_state().age_s(fleet.clock.now()) > 1.2)
        assert fleet.truth.report().violations == ()
        assert "what happened since then is not known" in caplog.text
        began_s = time.perf_counter()
        fleet.close()
        assert time.perf_counter() - began_s < 4.0


def test_a_fleet_that_was_never_ready_can_be_closed() -> None:
    fleet = ZmqBackend().open(ZmqConfig(workspace=ROOM), [SPEC])
    fleet.close()


def test_a_simulator_does_not_outlive_who_started_it() -> None:
    program = (
        "import sys, time; sys.path[:0] = sys.argv[1:]\n"
        "from soter.sdk import RobotSpec\n"
        "from soter.sdk.wire import Simulator\n"
        "from soter.geometry.workspace import Workspace\n"
        "room, spec = Workspace(4.0, 4.0, (), ()), RobotSpec(1, 1.0, 1.0, 0.0)\n"
        "print(Simulator('soter_zmq.robot', room, [spec]).process.pid, flush=True); time.sleep(60)\n"
    )
    paths = [path for path in sys.path if path]
    parent = subprocess.Popen([sys.executable, "-c", program, *paths], stdout=subprocess.PIPE)
    try:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    finally:
        parent.kill()
        parent.communicate()
    until_s = time.perf_counter() + 10.0
    while not gone(child) and time.perf_counter() < until_s:
        time.sleep(0.05)
    assert gone(child)


def test_a_robot_that_is_not_there_is_missed_in_time() -> None:
    config = ZmqConfig.model_validate({
        "workspace": ROOM, "robots": {1: {"command": "tcp://127.0.0.1:9", "report": "tcp://127.0.0.1:9"}}
    })  # fmt: skip
    with ZmqBackend().open(config, [SPEC]) as fleet:
        began_s = time.perf_counter()
        with pytest.raises(RobotUnavailable, match="is its process running"):
            fleet.robots[0].init(0.3)
        assert time.perf_counter() - began_s < 2.0


def test_a_robot_without_an_address_is_named(simulator: Simulator) -> None:
    with pytest.raises(RobotUnavailable, match=r"robots \[2\]"):
        ZmqBackend().open(given(simulator), [SPEC, RobotSpec(2, 4.0, 3.0, 0.0)])


@pytest.mark.parametrize("address", ["tcp://192.168.1.7:5000", "tcp://*:5000", "udp://127.0.0.1:5000"])
def test_addresses_stay_on_this_host(address: str) -> None:
    with pytest.raises(ValidationError, match="through a tunnel"):
        ZmqConfig.model_validate({"workspace": ROOM, "robots": {1: {"command": address, "report": address}}})


def test_a_simulator_that_does_not_start_says_so() -> None:
    with pytest.raises(RobotUnavailable, match="ended with code 1"):
        Simulator("soter_zmq.robot", ROOM, [RobotSpec(1, 2.0, 3.0, math.nan)])


def test_the_registry_takes_it() -> None:
    assert load_backend("soter_zmq.adapter:ZmqBackend") is ZmqBackend
