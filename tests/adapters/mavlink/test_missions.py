"""What happens to vehicles in the middle of a mission: seen within a second, in the result, and no peer is in danger.

The vehicles have the flaws of a real ArduRover, the mission is that of the documentation. In virtual time.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import GeoPoint
from soter.config import load_mission
from soter.conformance import CLAUSES, Verdict, find_harness, judge, select
from soter.conformance.given import Given, GivenHarness
from soter.runner import Follower, RunResult, run_mission
from soter.sdk import Controller, Fleet, GoalStatus, Robot, RobotSpec, Waypoint
from soter_sim.mavlink.kinds import Mode
from tests.adapters.mavlink.virtual import BACKEND, VirtualBackend, VirtualConfig, Wire

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SAFE = {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}
HAPPENS_S = 5.0
HOLD, MANUAL = 4.0, 0.0


def example(like: str) -> Path:
    """Return the mission file for vehicles that are like these."""
    return EXAMPLES / {"px4": "arducopter"}.get(like, like) / "mission.toml"


def options(like: str) -> dict[str, Any]:
    """Return the options of an example; in virtual time the vehicles' period is no longer than a sample is old."""
    given = dict(tomllib.loads(example(like).read_text(encoding="utf-8"))["backends"]["mavlink"])
    promise = given["promise"]
    waits_s = promise["latency_s"] + promise["setpoint_period_s"]
    return given | {"promise": promise | {"setpoint_period_s": 0.1, "latency_s": waits_s - 0.1}}


def run(
    happens: Callable[[Wire, float], object] = lambda *_: None, duration_s: float = 10.0, like: str = "ardurover"
) -> RunResult:
    """Run an example; `happens` is called after every tick with the wire and the time since `HAPPENS_S`."""
    given = {key: value for key, value in options(like).items() if key != "connection"} | {"like": like}
    overrides = {"backend": BACKEND, "duration_s": duration_s, "targets": "hostile", "backends": {BACKEND: given}}
    mission = load_mission(example(like), overrides)

    def pace(now_s: float) -> None:
        happens(VirtualBackend.wire, round(now_s - HAPPENS_S, 3))

    return run_mission(mission, follower=Follower(pace=pace)).result


def once(what: Callable[[Wire], object], at_s: float = 0.0) -> Callable[[Wire, float], object]:
    return lambda wire, now_s: what(wire) if now_s == at_s else None


def takes(mode: float) -> Callable[[Wire, float], object]:
    return once(lambda wire: wire.command(1, mav.MAV_CMD_DO_SET_MODE, 1.0, mode))


def disarms(wire: Wire) -> None:
    wire.command(1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0)


def sets(name: str, value: float) -> Callable[[Wire, float], object]:
    """Another ground station sets a parameter."""
    message = mav.MAVLink_param_set_message(1, 1, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32)
    return once(lambda wire: wire.other(message))


def sends_elsewhere(wire: Wire, now_s: float) -> None:
    """Another ground station goes on sending it to the other end of the field, between the ticks."""
    elsewhere = mav.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mav.MAV_FRAME_LOCAL_NED, 0x0DF8, 36.0, 36.0, *[0.0] * 9
    )
    if now_s in (0.0, 2.0):
        wire.between = (lambda: wire.other(elsewhere)) if now_s == 0.0 else (lambda: None)


def reboots(wire: Wire, now_s: float) -> None:
    if now_s == 0.0:
        disarms(wire)
    elif now_s == 0.1:
        wire.command(1, mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0)


def is_stopped(wire: Wire, now_s: float) -> None:
    """Its process stands still for 3 s, and its clock with it."""
    if now_s == 0.0:
        wire.cut.add(1)
    elif now_s == 3.0:
        wire.autopilot(1).booted_s += 3.0
        wire.cut.clear()


@pytest.mark.parametrize(
    ("happens", "says"),
    [
        (takes(HOLD), "it is in the mode HOLD, not GUIDED"),
        (takes(MANUAL), "it is in the mode MANUAL, not GUIDED"),
        (once(disarms), "it is disarmed"),
        (once(lambda wire: wire.cut.add(1)), "not been heard of"),
        (is_stopped, "not been heard of"),
        (sets("SIM_GPS_DISABLE", 1.0), "its GPS has found no place"),
        (sets("SIM_GPS1_ACC", 2.0), "its GPS says that it is off by up to 2.00 m, allowed: gps_accuracy_m = 0.60"),
        (sets("AHRS_EKF_TYPE", 2.0), "the origin of its EKF has moved by 14.5"),
        (sends_elsewhere, "another ground station sends it elsewhere"),
        (reboots, "it is disarmed"),
    ],
    ids=["hold", "manual", "disarm", "kill", "stop", "gps", "accuracy", "origin", "goto", "reboot"],
)
def test_what_happens_to_a_vehicle_is_seen_within_a_second_and_its_peer_has_heard_of_it(
    happens: Callable[[Wire, float], object], says: str
) -> None:
    at_s = []

    def happening(wire: Wire, now_s: float) -> None:
        happens(wire, now_s)
        if now_s == 0.0:
            at_s.append(wire.host_s)

    result = run(happening)
    assert says in result.uncontrolled[1].cause
    assert -0.01 <= min(each.first_s for each in result.assumptions[1].values()) - at_s[0] <= 1.0
    assert (result.status, result.violations) == ("completed", SAFE)
    # It may be anywhere its promise lets it: the AC of its peer is not in charge then.
    assert result.assumptions[2]["A7"].first_s - at_s[0] <= 1.0
    assert result.uncontrolled.keys() == {1}


def test_a_home_that_moves_is_said_and_takes_no_vehicle_away(caplog: pytest.LogCaptureFixture) -> None:
    lat_e7, lon_e7 = (round(1e7 * each) for each in GeoPoint(47.397742, 8.545594, 488.0).place(40.0, -30.0))
    moves = mav.MAVLink_command_int_message(
        1, 1, mav.MAV_FRAME_GLOBAL, mav.MAV_CMD_DO_SET_HOME, 0, 0, 0.0, 0.0, 0.0, 0.0, lat_e7, lon_e7, 488.0
    )
    result = run(once(lambda wire: wire.other(moves)))
    assert (result.status, result.violations, result.uncontrolled) == ("completed", SAFE, {})
    said = [each.getMessage() for each in caplog.records if "its HOME has moved" in each.getMessage()]
    assert len(said) == 1
    assert said[0].startswith("robot 1: its HOME has moved by ")


@pytest.mark.parametrize("like", ["ardurover", "arducopter", "px4"])
def test_with_all_their_flaws_two_vehicles_drive_their_mission_and_stand_in_the_end(like: str) -> None:
    fastest_m_s = 0.0

    def watches(wire: Wire, _now_s: float) -> None:
        nonlocal fastest_m_s
        fastest_m_s = max(fastest_m_s, *(abs(each) for each in wire.world.bodies.v))

    result = run(watches, 16.0, like)
    promised_m_s = options(like)["promise"]["v_max_m_s"]
    assert (result.status, result.violations, result.uncontrolled) == ("completed", SAFE, {})
    assert result.ac_share >= 0.8
    assert result.longest_stall_s <= 5.0
    assert 0.9 * promised_m_s <= fastest_m_s <= promised_m_s
    autopilots = VirtualBackend.wire.autopilots
    assert {each.mode.value for each in autopilots} == {"HOLD" if like == "ardurover" else "LAND"}
    assert not any(each.armed for each in autopilots if not each.kind.flies)


def test_a_px4_that_hears_no_more_targets_holds_and_is_taken_back_once_they_come_again() -> None:
    held: list[str] = []
    mode = "it is in the mode HOLD, not OFFBOARD"

    def stands_still(wire: Wire, now_s: float) -> None:
        # The mission's own process, for longer than COM_OF_LOSS_T.
        if now_s == 0.0:
            wire.sleep(2.0)
            held.extend(each.mode.value for each in wire.autopilots)
            assert max(map(abs, wire.world.bodies.v)) < 0.1

    result = run(stands_still, 20.0, "px4")
    assert held == ["LOITER", "LOITER"]
    assert (result.status, result.violations) == ("completed", SAFE)
    assert {each.cause for each in result.uncontrolled.values()} == {f"not under control: {mode}"}
    assert all(each.lasted_s < 8.0 for each in result.uncontrolled.values())


def test_when_nobody_is_heard_any_more_a_vehicle_is_at_rest_well_within_what_is_promised() -> None:
    ways_m: list[float] = []

    def dies(wire: Wire, now_s: float) -> None:
        # The adapter has not been asked for anything by the time that the next tick comes.
        if now_s == 0.0:
            bodies = wire.world.bodies
            before = list(zip(bodies.x, bodies.y, strict=True))
            assert max(bodies.v) > 0.9
            wire.sleep(4.0)
            assert max(map(abs, bodies.v)) < 0.02
            ways_m.extend(math.dist(*each) for each in zip(before, zip(bodies.x, bodies.y, strict=True), strict=True))
            raise KeyboardInterrupt

    assert run(dies).status == "interrupted"
    promise = options("ardurover")["promise"]
    unheard_s = sum(promise[name] for name in ("lease_s", "latency_s", "setpoint_period_s", "jitter_s"))
    stops_m = promise["v_max_m_s"] ** 2 / (2.0 * promise["brake_m_s2"])
    assert max(ways_m) <= 0.8 * (promise["v_max_m_s"] * unheard_s + stops_m + promise["overshoot_m"])


def given_vehicle(like: str = "ardurover", **promise: Any) -> tuple[VirtualConfig, RobotSpec]:
    """Return the first vehicle of an example, as a mission file has it."""
    workspace = load_mission(example(like)).read_workspace()
    given = {key: value for key, value in options(like).items() if key != "connection"}
    given["promise"] = {**given["promise"], **promise}
    config = VirtualConfig.model_validate({**given, "like": like, "workspace": workspace})
    start = workspace.robots[0]
    return config, RobotSpec(start.id, start.x_m, start.y_m, 0.3, promised=VirtualBackend.promises(config))


@contextmanager
def ready_rover() -> Iterator[tuple[Fleet, Robot, RobotSpec]]:
    """Yield the first rover of the example, ready, with its AC in charge."""
    config, spec = given_vehicle()
    with VirtualBackend().open(config, [spec]) as fleet:
        (robot,) = fleet.robots
        robot.init(60.0)
        robot.switch_ac_sc(Controller.AC, "test")
        yield fleet, robot, spec


def test_a_rover_that_has_rolled_beyond_its_target_does_not_turn_round() -> None:
    with ready_rover() as (fleet, robot, spec):
        robot.goto(Waypoint(spec.x_m + 2.0, spec.y_m + 1.0, radius_m=0.3), Controller.AC)
        turned_rad, x_m, y_m = 0.0, math.nan, math.nan
        for _ in range(240):
            fleet.clock.sleep_until(fleet.clock.now() + 0.05)
            robot.read_state()
            robot.renew_lease()
            x_m, y_m, heading_rad = VirtualBackend.wire.world.truth.pose(1)
            turned_rad = max(turned_rad, abs(math.remainder(heading_rad - 0.3, math.tau)))
        assert math.dist((x_m, y_m), (spec.x_m + 2.0, spec.y_m + 1.0)) <= 0.3
        assert turned_rad < 0.5


def test_a_rover_that_is_sent_to_where_it_is_stays_there() -> None:
    with ready_rover() as (fleet, robot, spec):
        at = robot.read_state()
        goal = robot.goto(Waypoint(at.x_m - 0.03, at.y_m - 0.02, radius_m=0.1), Controller.AC)
        for _ in range(100):
            fleet.clock.sleep_until(fleet.clock.now() + 0.05)
            robot.read_state()
            robot.renew_lease()
            assert abs(VirtualBackend.wire.world.truth.pose(1)[2] - spec.heading_rad) <= 0.05
        assert goal.status is GoalStatus.REACHED


def test_a_safe_controllers_leg_back_is_driven_backwards() -> None:
    config, spec = given_vehicle(reverses=True)
    record = judge(find_harness(Given(BACKEND, config, spec, 10.0)), select(["state.backwards", "goto.heading"]))
    assert {each.verdict for each in record.outcomes} == {Verdict.PASS}, record.outcomes


def test_clauses_of_the_kit_pass_on_one_that_it_did_not_start() -> None:
    # Its tail is that of the usual parameters, not of those of the example.
    config, spec = given_vehicle(brake_m_s2=0.9)
    record = judge(find_harness(Given(BACKEND, config, spec, 10.0)), select(["bounds.rest", "deadman.silence"]))
    tried = {each.clause.id: each.verdict for each in record.outcomes}
    assert tried == dict.fromkeys(("bounds.rest", "deadman.silence", "truth.deadman.silence"), Verdict.PASS)


class Landing(GivenHarness):
    """A copter whose link can be cut, which lands then, as the example has it."""

    landed = False

    def gives(self, hook: str) -> bool:
        return hook == "cut" or super().gives(hook)

    def cut(self, robot_id: int) -> None:
        VirtualBackend.wire.cut.add(robot_id)
        autopilot = VirtualBackend.wire.autopilot(robot_id)
        autopilot.parameters.set("LAND_SPEED", 50.0)
        autopilot.set_mode(Mode.LAND, "its fail-safe")

    def restore(self, robot_id: int) -> None:
        VirtualBackend.wire.cut.discard(robot_id)
        self.landed = not VirtualBackend.wire.autopilot(robot_id).armed


def test_a_copter_that_has_landed_by_itself_during_a_silence_obeys_once_it_flies_again() -> None:
    harness = Landing(Given(BACKEND, *given_vehicle("arducopter"), 20.0))
    (outcome,) = judge(harness, [CLAUSES["link.no_success"]]).outcomes
    assert outcome.verdict is Verdict.PASS, outcome.reason
    assert harness.landed
