"""Adapters that go wrong where two things meet, or one thing meets more time or room than is usual."""

from __future__ import annotations

import math
from typing import Any, Final

from soter.errors import RobotUnavailable
from soter.sdk import Capabilities, Goal, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.afterwards import State
from tests.broken.edits import driven, edited, sampled, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import braking_at, memory, with_control
from tests.conformance.wire import PERIOD_S, SAMPLE_PERIODS, Intent, Vehicle, WireRobot

_WIDE_M: Final = 0.25
_STEERS_RAD_S: Final = 0.25
_FAR_M: Final = 6.0
_WINDOW_M: Final = 5.0
_CELL_M: Final = 0.1
_SEES_M: Final = 0.8
_LANE_M: Final = 0.35
_SWERVE_RAD_S: Final = 1.0
_FIELD_M: Final = 0.4
_IN_FIELD: Final = 0.7
_SAME_M: Final = 0.25
_CREEPS_M_S: Final = 0.01
_LIFT: Final = 0.15
_LIFTS_S: Final = 20.0
_AT_CHARGER_M: Final = 0.2
_APART_S: Final = PERIOD_S * SAMPLE_PERIODS
_FIRST_WAIT_S: Final = 0.05
_LONGEST_WAIT_S: Final = 60.0


def _flies_by(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    if goal is None or speed == 0.0 or goal.target.radius_m < _WIDE_M:
        return speed, rate
    off_m = math.hypot(goal.target.x_m - state[1], goal.target.y_m - state[2])
    return (math.copysign(LIMITS.v_max_m_s, speed) if off_m <= goal.target.radius_m else speed), rate


def _brakes_less_in_curves(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    weak = memory(robot, "weak", lambda: [None])
    if abs(speed) >= abs(state[4]):
        weak[0] = None
    elif weak[0] is None:
        weak[0] = abs(state[5]) > _STEERS_RAD_S
    return braking_at(0.5)(robot, state, speed, rate) if weak[0] else (speed, rate)


def _sets_a_timer(robot: Any, goal: Goal) -> None:
    memory(robot, "timers", dict)[goal.id] = robot._world.now_s + goal.target.timeout_s
    Broken._send_goto(robot, goal)


def _timers_end(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    timers: dict[int, float] = memory(robot, "timers", dict)
    for number in [number for number, due_s in timers.items() if state[0] >= due_s]:
        del timers[number]
        robot._mux.halt()
    return speed, rate


def _drops_its_timer(robot: Any) -> None:
    if robot._mux.command is not None:
        memory(robot, "timers", dict).pop(robot._mux.command.id, None)
    Broken._halt(robot)


def _unwatched(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    if vars(robot._world).get("watch ended"):
        robot._mux.renew(state[0])
    return speed, rate


def _ends_the_watch(robot: Any, timeout_s: float) -> None:
    Broken._disconnect(robot, timeout_s)
    vars(robot._world)["watch ended"] = True


def _plans_in_cells(robot: Any, timeout_s: float) -> Any:
    """Drive to what is far away by a place in between, in the middle of a cell of a map."""
    found, vehicle = Broken._connect(robot, timeout_s), robot._vehicle
    between: dict[int, Waypoint | None] = {}

    def control(now_s: float, x_m: float, y_m: float, *turned: float) -> tuple[float, float]:
        goal = vehicle.mux.passing(now_s)
        if goal is None:
            return vehicle._drive.command(x_m, y_m, *turned, None)  # type: ignore[no-any-return]
        dx, dy = goal.target.x_m - x_m, goal.target.y_m - y_m
        if goal.id not in between:
            share = _WINDOW_M / math.hypot(dx, dy) if math.hypot(dx, dy) > _FAR_M else 0.0
            x, y = (round((at + share * on) / _CELL_M) * _CELL_M for at, on in ((x_m, dx), (y_m, dy)))
            between[goal.id] = goal.target._replace(x_m=x, y_m=y) if share else None
        by = between[goal.id]
        if by is not None and math.hypot(by.x_m - x_m, by.y_m - y_m) <= _CELL_M:
            by = between[goal.id] = None
        return vehicle._drive.command(x_m, y_m, *turned, by or goal.target)  # type: ignore[no-any-return]

    robot._world.set_control(robot.id, control)
    return found


def _swerves(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Round whoever is ahead, as a vehicle with an eye of its own does."""
    x_m, y_m, heading_rad = state[1:4]
    for other in range(len(robot._world.bodies.x)):
        dx, dy = robot._world.bodies.x[other] - x_m, robot._world.bodies.y[other] - y_m
        ahead_m = dx * math.cos(heading_rad) + dy * math.sin(heading_rad)
        aside_m = dy * math.cos(heading_rad) - dx * math.sin(heading_rad)
        if other != robot._index and 0.0 < ahead_m < _SEES_M and abs(aside_m) < _LANE_M and speed > 0.0:
            return speed, -_SWERVE_RAD_S if aside_m >= 0.0 else _SWERVE_RAD_S
    return speed, rate


def _stops_before_others(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Stand while somebody is near on the way ahead, as a vehicle with a protective field does."""
    bodies, (x_m, y_m, heading_rad) = robot._world.bodies, state[1:4]
    for other in range(len(bodies.x)):
        dx, dy = bodies.x[other] - x_m, bodies.y[other] - y_m
        ahead_m = math.copysign(1.0, speed) * (dx * math.cos(heading_rad) + dy * math.sin(heading_rad))
        if other != robot._index and math.hypot(dx, dy) < _FIELD_M and ahead_m > _IN_FIELD * math.hypot(dx, dy):
            return 0.0, rate
    return speed, rate


def _fails_once_failed(self: Any, timeout_s: float) -> Capabilities:
    """Leave a connection half made where it comes to nothing, and make none while there is one."""
    begun = memory(self, "begun", lambda: [False])
    if begun[0]:
        raise RobotUnavailable(f"robot {self.id}: operation already in progress")
    begun[0] = True
    found = WireRobot._connect(self, timeout_s)
    begun[0] = False
    return found


def _waits_for_its_place(robot: Any, goal: Goal) -> None:
    """Keep places for one robot at a time, as a manager of many does."""
    kept: dict[int, Waypoint] = vars(robot._world).setdefault("kept places", {})
    there = (each for robot_id, each in kept.items() if robot_id != robot.id)
    if not any(math.dist(each[:2], goal.target[:2]) < _SAME_M for each in there):
        kept[robot.id] = goal.target
        Broken._send_goto(robot, goal)


def _turns_as_it_subtracts(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Turn by the difference of two headings as they are."""
    goal = robot._mux.command
    if goal is None or speed != 0.0 or abs(state[4]) > _CREEPS_M_S or rate == 0.0:
        return speed, rate
    bearing_rad = math.atan2(goal.target.y_m - state[2], goal.target.x_m - state[1])
    return speed, math.copysign(rate, bearing_rad - math.remainder(state[3], math.tau))


def _by_voltage(robot: Any, state: RobotState) -> RobotState:
    """Read the charge from a voltage, which a charger lifts, and lets go of slowly."""
    lift, here_m = memory(robot, "lift", lambda: [0.0, 0.0]), math.dist(state[3:5], (robot.spec.x_m, robot.spec.y_m))
    share = 1.0 - math.exp(-(state.stamp_s - lift[1]) / _LIFTS_S)
    lift[:] = lift[0] + ((_LIFT if here_m < _AT_CHARGER_M else 0.0) - lift[0]) * share, state.stamp_s
    return state if state.battery is None else state._replace(battery=min(1.0, state.battery + lift[0]))


def _by_number(self: Any, intent: Intent, clock_s: float) -> None:
    """Take a goal for a new one where its number is another than that of the one before."""
    known = memory(self, "known", lambda: [None])
    if intent.goal is not None:
        if known[0] is None or known[0].id != intent.goal.id:
            known[0] = intent.goal
        intent = intent._replace(goal=known[0])
    Vehicle.take(self, intent, clock_s)


def _asks_while_it_talks(self: Any, clock_s: float) -> Goal | None:
    asked = memory(self, "asked", lambda: [None])
    if self.talks():
        asked[0] = self.mux.passing(clock_s)
    return asked[0]  # type: ignore[no-any-return]


def _backs_off(self: Any) -> list[RobotState]:
    """Wait twice as long after each try to connect, up to a minute."""
    waits, now_s = memory(self, "waits", lambda: [_FIRST_WAIT_S, 0.0]), self.clock.now()
    if now_s < waits[1]:
        return []
    try:
        found = self.up.receive(now_s)
    except ConnectionError:
        waits[:] = min(2.0 * waits[0], _LONGEST_WAIT_S), now_s + waits[0]
        return []
    waits[0] = _FIRST_WAIT_S
    return found  # type: ignore[no-any-return]


def _over_the_period(self: Any) -> list[RobotState]:
    """Take speeds as ways over the time that should lie between two samples, whatever was lost between them."""
    last, found = memory(self, "last", lambda: [None]), []
    for sample in WireRobot.received(self):
        before = last[0] or sample
        vx_m_s, vy_m_s = ((here - there) / _APART_S for here, there in zip(sample[3:5], before[3:5], strict=True))
        found.append(sample._replace(vx_m_s=vx_m_s, vy_m_s=vy_m_s))
        last[0] = sample
    return found


MEETING: Final[tuple[type[Broken], ...]] = (
    edited("FliesBy", "Drives through targets of a wide radius at full speed, and brakes behind them.",
           "bounds.overshoot", "too late", _connect=with_control(_flies_by)),
    edited("BrakesLessInCurves", "Brakes at half of what it promises where it steers as it begins to.",
           "bounds.braking", "while it steers", _connect=with_control(_brakes_less_in_curves)),
    edited("TimerOfAnother", "Stops whatever it does at the time-out of a goal that another has taken the place of.",
           "goal.timeout", "took the place", _send_goto=_sets_a_timer, _halt=_drops_its_timer,
           _connect=with_control(_timers_end)),
    edited("WatchesNoMore", "Watches no lease any more once one robot of several was closed.", "several.close",
           "ended with the one", _connect=with_control(_unwatched), _disconnect=_ends_the_watch),
    edited("Swerves", "Swerves round other robots by itself.", "truth.bounds.body", "an avoidance of its own",
           _connect=with_control(_swerves)),
    edited("StopsBeforeOthers", "Stands while another robot is within 0.4 m ahead.", "truth.bounds.body",
           "a field of the vehicle's own", _connect=with_control(_stops_before_others)),
    edited("KeepsPlaces", "Sends no robot to where another one was sent.", "truth.bounds.body", "one robot at a time",
           _send_goto=_waits_for_its_place),
    edited("TurnsAsItSubtracts", "Turns the long way round where the short one leads across west.", "bounds.pivot",
           "long way round", _connect=with_control(_turns_as_it_subtracts)),
    sampled("ReadsVoltage", "Takes the voltage for the charge, which a charger lifts within a minute.",
            "truth.state.charge", "a voltage", _by_voltage),
    edited("PlansInCells", "Drives to what is more than 6 m away by a place in between, which lies on a grid of 0.1 m.",
           "truth.bounds.leg", "places between", _connect=_plans_in_cells),
)  # fmt: skip

MEETING_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("KnowsGoalsByNumber", "Takes a goal of the next program for that of the one before that has its number.",
           "authority.next_program", "numbers alone", take=_by_number),
    driven("AsksWhileItTalks", "Asks whether its lease lives where it hears and talks, and not where it drives.",
           "deadman.stalled", "lease or not", passing=_asks_while_it_talks),
    wired("SpeedsOverThePeriod", "Takes speeds from two places and the time that should lie between them.", "link.loss",
          "two places", received=_over_the_period),
    wired("BacksOff", "Waits twice as long after each try to connect again, up to a minute.", "link.returns",
          "the longer it takes|nothing is heard", received=_backs_off),
    wired("FailsOnceFailed", "Cannot be made ready any more once that has failed.", "link.in_time", "has failed leaves",
          _connect=_fails_once_failed),
)  # fmt: skip
