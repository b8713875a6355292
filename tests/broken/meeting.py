"""Adapters that go wrong where two things meet: a wide radius, a curve, a goal in another's place, a robot closed."""

from __future__ import annotations

import math
from typing import Any, Final

from soter.sdk import Goal
from soter_sim import LIMITS
from tests.broken.afterwards import State
from tests.broken.edits import edited
from tests.broken.in_process import Broken
from tests.broken.parts import braking_at, memory, with_control

_WIDE_M: Final = 0.25
_STEERS_RAD_S: Final = 0.25


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
)  # fmt: skip
