"""The adapters with simulated vehicles in a process of their own. Bounds are wide: the machine may have more to do."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.backend import MavlinkBackend, MavlinkFleet, VehicleBackend
from soter.adapters.mavlink.harness import MavlinkHarness, PlainHarness
from soter.adapters.mavlink.mavsdk_backend import MavsdkBackend
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.adapters.mavlink.simulator import MavlinkSimulator, free_port
from soter.config import load_mission
from soter.conformance import CLAUSES as KIT
from soter.conformance import WIDE_ROOMS, Verdict, find_harness, judge
from soter.conformance.driver import drive_until
from soter.errors import ConfigError, RobotUnavailable, Uncontrolled
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import load_backend
from soter.runner import run_mission
from soter.sdk import Controller, Fleet, GoalStatus, Link, Robot, RobotSpec, RuleLimits, Waypoint
from soter.sdk.wire import describe

AC, SC = Controller.AC, Controller.SC
ROOM = Workspace(6.0, 5.0, (), (RobotPlace(1, 2.0, 3.0, Box(1.9, 2.9, 2.1, 3.1)),))
SPEC = RobotSpec(1, 2.0, 3.0, 0.7, 0.5)
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
BACKENDS = pytest.mark.parametrize("backend", [MavlinkBackend, MavsdkBackend], ids=["mavlink", "mavsdk"])


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def config(**options: Any) -> MavlinkConfig:
    return MavlinkConfig.model_validate({"workspace": ROOM, "boot_s": 0.5, **options})


def simulator(stack: ExitStack, port: int, *options: str) -> MavlinkSimulator:
    made = MavlinkSimulator(describe(ROOM, [SPEC], RuleLimits()), port, "--rate", "50", "--boot", "0.5", *options)
    stack.callback(made.close)
    return made


def started(stack: ExitStack, backend: type[VehicleBackend] = MavlinkBackend, **options: Any) -> MavlinkFleet:
    fleet = backend().open(config(**options), [SPEC])
    stack.callback(fleet.close)
    fleet.robots[0].init(20.0)
    return fleet


def tick(fleet: Fleet, until: Callable[[], bool], limit_s: float = 15.0, *, renew: bool = True) -> bool:
    return drive_until(fleet, until, limit_s, renew=renew)


def disobeys(robot: Robot) -> str:
    try:
        robot.renew_lease()
    except Uncontrolled as failure:
        return str(failure)
    return ""


def speed(robot: Robot) -> float:
    state = robot.read_state()
    return math.hypot(state.vx_m_s, state.vy_m_s)


def really(fleet: Fleet) -> tuple[float, float, float]:
    assert fleet.truth is not None
    return fleet.truth.pose(fleet.robots[0].id)


@BACKENDS
@pytest.mark.parametrize("vehicle", ["rover", "copter"])
def test_a_vehicle_is_where_it_says_and_goes_where_it_is_told(
    stack: ExitStack, backend: type[VehicleBackend], vehicle: str
) -> None:
    fleet = started(stack, backend, vehicle=vehicle, height_m=0.5)
    robot = fleet.robots[0]
    state = robot.read_state()
    assert (state.x_m, state.y_m, state.heading_rad) == pytest.approx((2.0, 3.0, 0.7), abs=1e-3)
    assert state.controller is SC
    # It stands on its station, and has done so since it booted.
    assert state.battery is not None
    assert 0.489 <= state.battery <= 0.511 + state.vehicle_stamp_s / SPEC.charge_s
    goal = robot.goto(Waypoint(1.6, 3.3), SC)
    assert tick(fleet, lambda: not goal.active)
    assert goal.status is GoalStatus.REACHED
    assert tick(fleet, lambda: speed(robot) < 1e-3)
    assert math.dist(really(fleet)[:2], (1.6, 3.3)) <= 0.03
    assert fleet.truth is not None
    assert fleet.truth.report().violations == ()


def test_a_real_speed_up_is_kept_in_fleet_time(stack: ExitStack) -> None:
    fleet = started(stack, speedup=3.0)
    robot = fleet.robots[0]
    before_s, host_s = robot.read_state().vehicle_stamp_s, time.perf_counter()
    tick(fleet, lambda: False, 3.0)
    passed_s = robot.read_state().vehicle_stamp_s - before_s
    assert 1.5 < passed_s < 4.0
    assert time.perf_counter() - host_s < 2.8
    assert robot.read_state().age_s(fleet.clock.now()) < 1.0


def test_a_switch_is_confirmed_by_the_vehicle_and_stops_what_the_other_had(stack: ExitStack) -> None:
    fleet = started(stack)
    robot = fleet.robots[0]
    robot.switch_ac_sc(AC, "test")
    goal = robot.goto(Waypoint(3.5, 3.5), AC)
    assert tick(fleet, lambda: speed(robot) > 0.2)
    switch = robot.switch_ac_sc(SC, "test")
    assert goal.status is GoalStatus.PREEMPTED
    assert tick(fleet, lambda: speed(robot) < 1e-3 and switch.confirmed_s is not None)


@pytest.mark.parametrize("options", [(), ("--plain",)], ids=["gated", "plain"])
def test_without_renewal_the_vehicle_stops(stack: ExitStack, options: tuple[str, ...]) -> None:
    port = free_port()
    truth = simulator(stack, port, *options).truth
    fleet = started(stack, connection=f"udpin:127.0.0.1:{port}", truth=truth)
    robot = fleet.robots[0]
    robot.goto(Waypoint(3.5, 3.5), SC)
    assert tick(fleet, lambda: speed(robot) > 0.2)
    assert tick(fleet, lambda: speed(robot) < 1e-3, 2.0, renew=False)
    assert tick(fleet, lambda: speed(robot) > 0.2)


def test_messages_can_be_signed(stack: ExitStack, tmp_path: Path) -> None:
    passphrase = tmp_path / "passphrase"
    passphrase.write_text("not for others\n", encoding="utf-8")
    fleet = started(stack, passphrase_file=passphrase)
    goal = fleet.robots[0].goto(Waypoint(2.2, 3.1), SC)
    assert tick(fleet, lambda: goal.status is GoalStatus.REACHED)


def test_a_passphrase_that_is_none_is_named(tmp_path: Path) -> None:
    empty = tmp_path / "passphrase"
    empty.write_text("\n", encoding="utf-8")
    for path, why in ((empty, "no passphrase"), (tmp_path / "missing", "No such file")):
        with pytest.raises(ConfigError, match=f"passphrase_file: .*{why}"):
            MavlinkBackend().open(config(passphrase_file=path), [SPEC])
    with pytest.raises(ConfigError, match="cannot sign; use the backend 'mavlink'"):
        MavsdkBackend().open(config(passphrase_file=empty), [SPEC])


def test_vehicles_over_tcp(stack: ExitStack) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "soter_sim.mavlink", "--tcp", "0", "--rate", "50", "--boot", "0.5",
         "--parent", str(os.getpid())],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:  # fmt: skip
        stack.callback(process.wait)
        stack.callback(process.terminate)
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(describe(ROOM, [SPEC], RuleLimits()))
        process.stdin.close()
        ready = json.loads(process.stdout.readline())
        fleet = started(stack, connection=ready["links"][0], truth=ready["truth"])
        goal = fleet.robots[0].goto(Waypoint(2.2, 3.1), SC)
        assert tick(fleet, lambda: goal.status is GoalStatus.REACHED)
        stack.pop_all().close()


@BACKENDS
def test_a_vehicle_that_is_killed_is_missed_and_goes_on_when_it_is_back(
    stack: ExitStack, backend: type[VehicleBackend]
) -> None:
    port = free_port()
    first = simulator(stack, port)
    fleet = started(stack, backend, connection=f"udpin:127.0.0.1:{port}")
    robot = fleet.robots[0]
    goal = robot.goto(Waypoint(2.5, 3.4), SC)
    assert tick(fleet, lambda: speed(robot) > 0.2)
    first.process.send_signal(signal.SIGKILL)
    links: list[Link] = []

    def gone() -> bool:
        links.append(robot.read_state().link)
        return links[-1] is Link.DOWN

    assert tick(fleet, gone)
    assert links.index(Link.STALE) < links.index(Link.DOWN)
    assert goal.active
    simulator(stack, port)
    assert tick(fleet, lambda: robot.read_state().link is Link.UP)
    # The same goal, from where it woke up.
    assert tick(fleet, lambda: goal.status is GoalStatus.REACHED, 30.0)
    # While there is a vehicle that says that it stands.
    fleet.close()


def test_a_vehicle_stops_when_who_drives_it_is_killed(stack: ExitStack) -> None:
    harness = MavlinkHarness()
    stack.callback(harness.close)
    process = harness.start_driver(Waypoint(144.0, 74.5))
    driven = WIDE_ROOMS.robots[0].id
    began_s, first = time.perf_counter(), harness.observe(driven)
    while math.dist(first[:2], harness.observe(driven)[:2]) < 0.2:
        assert time.perf_counter() - began_s < 30.0
        time.sleep(0.02)
    process.kill()
    process.wait()
    time.sleep(0.7)
    rest = harness.observe(driven)
    time.sleep(0.5)
    assert harness.observe(driven) == rest
    assert math.dist(rest[:2], (144.0, 74.5)) > 0.2


def test_nobody_takes_a_port_from_who_listens_there(stack: ExitStack) -> None:
    port = free_port()
    simulator(stack, port)
    started(stack, connection=f"udpin:127.0.0.1:{port}")
    with pytest.raises(RobotUnavailable, match="end the other program"):
        MavlinkBackend().open(config(connection=f"udpin:127.0.0.1:{port}"), [SPEC])


@pytest.mark.parametrize("robot_id", [0, 255, 300])
def test_an_id_that_is_no_system_id_is_named(robot_id: int) -> None:
    with pytest.raises(RobotUnavailable, match=f"robot {robot_id}: its id is no system id"):
        MavlinkBackend().open(config(), [RobotSpec(robot_id, 2.0, 3.0, 0.0)])


@pytest.mark.parametrize("name", ["l-hall.toml", "harbour.geojson"])
def test_simulated_vehicles_live_in_a_world_of_any_shape(name: str) -> None:
    chosen = {"backend": "mavlink", "workspace": name, "robots": 1, "duration_s": 4.0, "planner": "straight-line"}
    result = run_mission(load_mission(EXAMPLES / "worlds" / "patrol.toml", chosen)).result
    assert (result.status, result.violated) == ("completed", False)
    assert result.min_margin is not None
    assert result.min_margin["geofence"] < 100.0, "its truth has the fence"


def test_closing_ends_the_simulated_vehicles(stack: ExitStack) -> None:
    fleet = started(stack)
    assert fleet.simulator is not None
    process = fleet.simulator.process
    fleet.close()
    fleet.close()
    assert process.poll() is not None


def test_a_simulator_that_does_not_start_says_so() -> None:
    with pytest.raises(RobotUnavailable, match="ended with code 2"):
        MavlinkSimulator(b'{"width_m": 1.0}', free_port())


@pytest.mark.parametrize("name", ["mavlink", "mavsdk"])
def test_the_registry_knows_them(name: str) -> None:
    assert issubclass(load_backend(name), VehicleBackend)
    assert find_harness(name).name == name


@pytest.mark.parametrize(
    ("harness", "clause"),
    [
        ("mavlink", "state.start"),
        ("mavlink", "authority.disabled"),
        ("mavlink", "lifecycle.close_twice"),
        ("mavsdk", "truth.state.start"),
        ("mavsdk", "lifecycle.close_twice"),
    ],
)
def test_a_clause_of_the_kit_passes(harness: str, clause: str) -> None:
    record = judge(find_harness(harness), [KIT[clause]])
    assert [(each.verdict, each.reason) for each in record.outcomes] == [(Verdict.PASS, "")]


def test_a_vehicle_without_a_gate_goes_on_when_its_link_is_back(stack: ExitStack) -> None:
    harness = PlainHarness()
    stack.callback(harness.close)
    fleet = stack.enter_context(harness.open(1))
    robot = fleet.robots[0]
    robot.init(20.0)
    assert not robot.capabilities.reports_controller
    robot.down_after_s = 1.0
    goal = robot.goto(Waypoint(142.9, 73.8), SC)
    assert tick(fleet, lambda: speed(robot) > 0.2)
    harness.cut(robot.id)
    assert tick(fleet, lambda: robot.read_state().link is Link.DOWN)
    rest = really(fleet)
    harness.restore(robot.id)
    assert tick(fleet, lambda: robot.read_state().link is Link.UP)
    # What was sent while the link was cut does not arrive late.
    assert math.dist(really(fleet)[:2], rest[:2]) < 0.05
    assert tick(fleet, lambda: goal.status is GoalStatus.REACHED)


def test_a_rover_without_a_lease_that_hears_nothing_more_while_it_turns_stays_where_it_is(stack: ExitStack) -> None:
    harness = PlainHarness()
    stack.callback(harness.close)
    fleet = stack.enter_context(harness.open(1))
    robot = fleet.robots[0]
    robot.init(20.0)
    # So that the kit does not hold it to ending a turn when the lease ends, which it cannot.
    assert not robot.capabilities.pivots_first
    x_m, y_m, heading_rad = really(fleet)
    robot.goto(Waypoint(x_m - math.cos(heading_rad), y_m - math.sin(heading_rad)), SC)
    assert tick(fleet, lambda: abs(math.remainder(really(fleet)[2] - heading_rad, math.tau)) > 0.4)
    caps, heard_rad = robot.capabilities, really(fleet)[2]
    turned_s = math.pi / caps.yaw_rate_max_rad_s
    fleet.clock.sleep_until(fleet.clock.now() + turned_s + 1.0)
    rest = really(fleet)
    fleet.clock.sleep_until(fleet.clock.now() + 0.3)
    assert really(fleet) == pytest.approx(rest, abs=1e-3)
    assert rest[:2] == pytest.approx((x_m, y_m), abs=1e-3)
    # It turns no further than within its lease.
    assert abs(math.remainder(rest[2] - heard_rad, math.tau)) <= caps.yaw_rate_max_rad_s * (
        caps.lease_s + caps.latency_s
    )


@BACKENDS
def test_one_with_the_flaws_of_ardurover_is_driven_and_is_nobodys_when_it_is_lost(
    stack: ExitStack, backend: type[VehicleBackend]
) -> None:
    port = free_port()
    truth = simulator(stack, port, "--like", "ardurover").truth
    noisy = {"speed_noise_m_s": 0.05, "position_noise_m": 0.3}
    fleet = started(stack, backend, connection=f"udpin:127.0.0.1:{port}", truth=truth, promise=noisy)
    robot = fleet.robots[0]
    assert isinstance(robot, MavlinkRobot)
    before = really(fleet)
    tick(fleet, lambda: False, 0.7)
    # It is told to stand all the time, and does not turn.
    assert really(fleet) == before
    goal = robot.goto(Waypoint(2.5, 3.4, radius_m=0.3), SC)
    assert tick(fleet, lambda: not goal.active)
    assert goal.status is GoalStatus.REACHED
    robot.goto(Waypoint(3.5, 3.5), SC)
    steps: list[tuple[Callable[[], None], str]] = [
        (lambda: robot._vehicle.set_parameter(KEEPER, "SIM_GPS_DISABLE", 1), "its GPS has found no place"),
        (lambda: robot._vehicle.set_mode(KEEPER, 4), "its GPS has found no place"),
        (lambda: robot._vehicle.set_parameter(KEEPER, "SIM_GPS_DISABLE", 0), "it is in the mode HOLD"),
    ]
    for wrong, says in steps:
        wrong()
        assert tick(fleet, lambda says=says: says in disobeys(robot), 2.0)  # type: ignore[misc]


@pytest.mark.parametrize("backend", ["mavlink", "mavsdk"])
def test_a_mission_runs_in_real_time_and_breaks_no_rule(backend: str) -> None:
    mission = load_mission(
        EXAMPLES / "surveillance.toml", {"backend": backend, "planner": "straight-line", "duration_s": 3.0}
    )
    result = run_mission(mission).result
    assert result.status == "completed"
    assert result.wall_s >= 2.9
    assert result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
    assert not result.failed_robots
