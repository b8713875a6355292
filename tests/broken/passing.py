"""Adapters that do right in what is looked at first, and otherwise before, after or beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from soter.sdk import Controller, RobotState, Waypoint
from tests.broken.edits import edited, sampled, targeted
from tests.broken.in_process import Broken
from tests.broken.parts import braking_at, counted, memory, with_control
from tests.broken.seldom import State

_SLOW_M_S: Final = 0.19
_SLOW_RAD_S: Final = 2.4
_AFTER_S: Final = 5.0
_WINDS_UP_S: Final = 2.0
_TIRES_M: Final = 10.0
_LONG_M: Final = 1.4
_SLEEPS_S: Final = 20.0
_WAKES_S: Final = 0.4
_SOFTLY: Final = braking_at(0.5)


def _too_fast_where(where: Callable[[Any, State], bool]) -> dict[str, Any]:
    """Return parts of a robot that keeps to a lower speed than its motors, but not everywhere."""

    def edit(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
        return (speed if where(robot, state) else max(min(speed, _SLOW_M_S), -_SLOW_M_S)), rate

    return {"declared": replace(Broken.declared, v_max_m_s=_SLOW_M_S), "_connect": with_control(edit)}


def _wound_up(robot: Any, state: State) -> bool:
    mux, dead_s = robot._mux, memory(robot, "dead", lambda: [-math.inf])
    if mux.command is not None and mux.passing(state[0]) is None and state[0] > 0.5:
        dead_s[0] = state[0]
    return bool(state[0] - dead_s[0] < _WINDS_UP_S)


def _turns_fast(robot: Any, _: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    if goal is None or goal.target.heading_rad is None:
        rate = max(min(rate, _SLOW_RAD_S), -_SLOW_RAD_S)
    return speed, rate


def _goes_home(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    mux, since_s = robot._mux, memory(robot, "since", lambda: [math.inf])
    dead = mux.command is not None and not mux.alive(state[0])
    since_s[0] = min(since_s[0], state[0]) if dead else math.inf
    return (0.1, 0.0) if state[0] - since_s[0] > _AFTER_S else (speed, rate)


def _tires(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    way = memory(robot, "way", lambda: [0.0])
    way[0] += abs(state[4]) * robot._world.period_s
    return _SOFTLY(robot, state, speed, rate) if way[0] > _TIRES_M else (speed, rate)


def _sleeps(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    idle_s, woken_s = memory(robot, "idle", lambda: [0.0]), memory(robot, "woken", lambda: [-math.inf])
    if robot._mux.passing(state[0]) is None:
        idle_s[0] += robot._world.period_s
    else:
        woken_s[0], idle_s[0] = (state[0] if idle_s[0] > _SLEEPS_S else woken_s[0]), 0.0
    return (0.0, 0.0) if state[0] - woken_s[0] < _WAKES_S else (speed, rate)


def _beyond_long_ways(robot: Any, to: Waypoint) -> Waypoint:
    at = robot._honest()
    way_m = math.dist((at.x_m, at.y_m), to[:2])
    if not _LONG_M < way_m < 2.0 * _LONG_M:
        return to
    share = 1.0 + 0.04 / way_m
    return to._replace(x_m=at.x_m + share * (to.x_m - at.x_m), y_m=at.y_m + share * (to.y_m - at.y_m))


def _unrenewed(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    if goal is not None and robot._mux._renewed_s == -math.inf:
        speed, rate = robot._vehicle._drive.command(*state[1:], goal.target)
    return speed, rate


def _keeps_naming(robot: Any, state: RobotState) -> RobotState:
    named = memory(robot, "named", lambda: [None])
    named[0] = named[0] if state.goal_id is None else state.goal_id
    return state._replace(goal_id=named[0])


PASSING: Final[tuple[type[Broken], ...]] = (
    edited("ScFaster", "Goes 15 % too fast for the SC.", "goal.of_sc", "at any time",
           **_too_fast_where(lambda robot, _: robot._mux.in_charge is Controller.SC)),
    edited("WindsUp", "Goes 15 % too fast for a while once its lease has died and lives again.", "deadman.recovers",
           "at any time", **_too_fast_where(_wound_up)),
    edited("TurnsFast", "Turns 18 % too fast to the heading of a goal.", "goto.heading", "at any time",
           declared=replace(Broken.declared, yaw_rate_max_rad_s=_SLOW_RAD_S), _connect=with_control(_turns_fast)),
    edited("GoesHome", "Drives home by itself 5 s after its lease has died.", "deadman.stays", "fail-safe",
           _connect=with_control(_goes_home)),
    edited("BrakesTire", "Brakes at half of what it promises once it has driven 10 m.", "endurance.minute",
           "brake_m_s2", _connect=with_control(_tires)),
    edited("Sleeps", "Takes 0.4 s to wake up after 20 s of rest.", "goto.wakes", "wake up",
           _connect=with_control(_sleeps)),
    targeted("BeyondLongWays", "Runs 4 cm beyond targets that were far away.", "bounds.overshoot", "overshoot_m",
             _beyond_long_ways),
    edited("Unrenewed", "Drives before its lease is renewed for the first time.", "deadman.first", "first time",
           _connect=with_control(_unrenewed)),
    edited("OneCancelInForty", "Loses one cancel in forty.", "goal.cancels", "lost",
           _halt=lambda self: Broken._halt(self) if counted(self, "halts") % 40 else None),
    sampled("KeepsNaming", "Names a goal that was cancelled until there is another.", "goal.ids", "was cancelled",
            _keeps_naming),
    sampled("NobodyInCharge", "Says of one sample in fifty not who is in charge.", "state.ranges", "who is in charge",
            lambda robot, s: s._replace(controller=None) if counted(robot) % 50 == 0 else s),
    sampled("StopsInWords", "Says that it stands as soon as it is told to stop.", "state.velocity", "was told",
            lambda robot, s: s._replace(vx_m_s=0.0, vy_m_s=0.0) if robot._mux.command is None else s),
)  # fmt: skip
