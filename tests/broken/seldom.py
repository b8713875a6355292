"""Adapters that go wrong in one state only, after a while, or seldom; one line of a table each."""

from __future__ import annotations

import math
import mmap
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from soter.sdk import Controller, RobotState
from soter_sim import LIMITS
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import acting_late, braking_at, counted, memory, with_control
from tests.broken.wire_mutants import _acting
from tests.conformance.wire import PERIOD_S, Intent, Vehicle, WireRobot

State = tuple[float, ...]
"""What a control is called with: now_s, x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s."""

_SLOW_M_S: Final = 0.19


def _braking_where(where: Callable[[Any, State], bool], share: float) -> Callable[..., tuple[float, float]]:
    weak = braking_at(share)

    def edit(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
        return weak(robot, state, speed, rate) if where(robot, state) else (speed, rate)

    return edit


def _runs_away(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    run = memory(robot, "run", lambda: [0.0])
    run[0] = run[0] + state[4] * robot._world.period_s if state[4] > 0.15 else 0.0
    return (speed if run[0] > 1.2 else max(min(speed, _SLOW_M_S), -_SLOW_M_S)), rate


def _rested_s(robot: Any, state: State) -> float:
    """Return for how long it has not moved."""
    since = memory(robot, "rests since", lambda: [state[0]])
    if abs(state[4]) + abs(state[5]) > 1e-3:
        since[0] = state[0]
    return float(state[0] - since[0])


def _wakes_late(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    woken = memory(robot, "woken", lambda: [math.inf])
    if _rested_s(robot, state) < 5.0 or (speed, rate) == (0.0, 0.0):
        woken[0] = math.inf
        return speed, rate
    woken[0] = min(woken[0], state[0])
    return (speed, rate) if state[0] > woken[0] + 0.3 else (0.0, 0.0)


def _creeps_after_a_while(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    idle = memory(robot, "idle", lambda: [state[0]])
    if robot._mux.command is not None:
        idle[0] = state[0]
    return (0.01, 0.0) if state[0] - idle[0] > 3.0 else (speed, rate)


def _turns_on(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    turned = memory(robot, "turned", lambda: [0.0])
    turned[0] = turned[0] + abs(state[5]) * robot._world.period_s if abs(state[5]) > 0.1 else 0.0
    if 0.0 < turned[0] < 2.5 and rate == 0.0:
        rate = math.copysign(LIMITS.yaw_rate_max_rad_s, state[5])
    return speed, rate


def _late_on_its_way(robot: Any, goal: Any) -> None:
    moves = abs(robot._v[robot._index]) > 0.05 and robot._mux.command is not None
    (_LATE["_send_goto"] if moves else Broken._send_goto)(robot, goal)


_LATE: Final = acting_late(5)


def _full_at_once(robot: Any, state: RobotState) -> RobotState:
    before = memory(robot, "charge", lambda: [state.battery, state.stamp_s, False])
    if state.stamp_s > before[1]:
        before[:] = state.battery, state.stamp_s, (state.battery or 0.0) > before[0]
    return state._replace(battery=1.0) if before[2] else state


def _idle_free(robot: Any, state: RobotState) -> RobotState:
    """Add up again what was lost at rest."""
    kept = memory(robot, "kept charge", lambda: [state.battery, state.stamp_s, 0.0])
    if state.stamp_s > kept[1]:
        still = math.hypot(state.vx_m_s, state.vy_m_s) + abs(state.yaw_rate_rad_s) < 1e-3
        kept[:] = state.battery, state.stamp_s, kept[2] + still * max(kept[0] - (state.battery or 0.0), 0.0)
    return state._replace(battery=min((state.battery or 0.0) + kept[2], 1.0))


def _up_to_speed_first(robot: Any) -> None:
    """Stop once it is up to speed, where it is gaining speed."""
    if 0.0 < abs(robot._v[robot._index]) < 0.2:
        robot._world_halts = True
    else:
        Broken._halt(robot)


def _halts_when_fast(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    if getattr(robot, "_world_halts", False) and abs(state[4]) >= 0.2:
        robot._world_halts = False
        Broken._halt(robot)
    return speed, rate


def _served_late(robot: Any) -> None:
    """Stop at once where it drives alone, and a little later where another one drives, too."""
    if sum(abs(v) > 0.05 for v in robot._v) > 1:
        _LATE["_halt"](robot)
    else:
        Broken._halt(robot)


def _resumes(robot: Any, to: Controller) -> None:
    old = robot._mux.command
    Broken._hand_over(robot, to)
    memory(robot, "resumed", lambda: [None])[0] = old


def _resuming(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Go on with what was pre-empted once what came after it is reached."""
    old, goal = memory(robot, "resumed", lambda: [None]), robot._mux.command
    there = goal is not None and math.hypot(goal.target.x_m - state[1], goal.target.y_m - state[2]) < 0.02
    if old[0] is not None and goal is not old[0] and there and (speed, rate) == (0.0, 0.0):
        robot._mux.command = old[0]
    return speed, rate


def _curving(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Steer to a target that is not too far to the side, where it ought to brake and turn."""
    goal = robot._mux.passing(state[0])
    if goal is None or speed != 0.0 or state[4] < 0.1:
        return speed, rate
    bearing = math.atan2(goal.target.y_m - state[2], goal.target.x_m - state[1])
    off = math.remainder(bearing - state[3], 2.0 * math.pi)
    return (0.2, math.copysign(1.0, off)) if 0.1 < abs(off) < 1.0 else (speed, rate)


def _keeps_all(robot: Any, state: RobotState) -> RobotState:
    # Pages of its own: in memory that something else has let go of, growth would not show.
    memory(robot, "heard", list).append(page := mmap.mmap(-1, 4096))
    page[0] = 1
    return state


def _drifts(robot: Any, state: RobotState) -> RobotState:
    way = memory(robot, "way", lambda: [0.0, state.stamp_s])
    way[0] += math.hypot(state.vx_m_s, state.vy_m_s) * (state.stamp_s - way[1])
    way[1] = state.stamp_s
    return state._replace(x_m=state.x_m + 5e-4 * way[0])


def _forgets_its_lease(self: Any) -> None:
    Vehicle.restart(self)
    self.mux.lease_s = 1.0


def _gauge_anew(self: Any) -> None:
    Vehicle.restart(self)
    self.gauge = 1.0


def _gauged(self: Any, *arguments: float) -> RobotState:
    honest = Vehicle.sample(self, *arguments)
    return honest._replace(battery=getattr(self, "gauge", honest.battery))


def _busy_once_a_minute(self: Any, intent: Intent, clock_s: float) -> None:
    """Let what comes wait for 60 ms, once a minute, and what comes after it queue."""
    until, now_s = memory(self, "busy", lambda: [0, 0.0]), self.world.now_s
    if int(now_s / 60.0) > until[0]:
        until[:] = int(now_s / 60.0), now_s + 0.06
    if now_s < until[1]:
        memory(self, "waiting", list).append((self.periods + math.ceil((until[1] - now_s) / PERIOD_S), intent))
    else:
        Vehicle.take(self, intent, clock_s)


def _seldom_at_rest(self: Any) -> RobotState | None:
    found = WireRobot._sample(self)
    kept = memory(self, "kept sample", lambda: [found])
    moves = found is not None and abs(found.vx_m_s) + abs(found.vy_m_s) + abs(found.yaw_rate_rad_s) > 1e-3
    if moves or found is None or kept[0] is None or found.stamp_s - kept[0].stamp_s >= 0.3:
        kept[0] = found
    return kept[0]  # type: ignore[no-any-return]


SELDOM: Final[tuple[type[Broken], ...]] = (
    edited("BrakesFade", "Brakes at half of what it promises when its battery is low.", "bounds.braking", "brake_m_s2",
           _connect=with_control(_braking_where(lambda robot, _: robot._charge[robot._index] < 0.3, 0.5))),
    edited("WeakBackwards", "Brakes at 60 % of what it promises while it reverses.", "bounds.braking", "backwards",
           _connect=with_control(_braking_where(lambda _, state: state[4] < -0.01, 0.6))),
    edited("RunsAway", "Goes 15 % too fast once it has gone straight on for 1.2 m.", "goto.v_max", "v_max_m_s",
           declared=replace(Broken.declared, v_max_m_s=_SLOW_M_S), _connect=with_control(_runs_away)),
    edited("SavesPower", "Takes 0.3 s to wake up after 5 s of rest.", "goto.wakes", "wake up",
           _connect=with_control(_wakes_late)),
    edited("CreepsAfterAWhile", "Creeps at 1 cm/s when nothing was asked of it for 3 s.", "goto.wakes", "creeps",
           _connect=with_control(_creeps_after_a_while)),
    edited("TurnsOn", "Looks at what it is told when it has turned.", "deadman.turning", "goes on to turn",
           _connect=with_control(_turns_on)),
    edited("LateOnItsWay", "Acts 0.25 s late on a goal that replaces another on the way.", "goal.replaced",
           "old target", _connect=_LATE["_connect"], _send_goto=_late_on_its_way),
    sampled("FullAtOnce", "Says that it is full as soon as it is being charged.", "state.charge", "full as soon",
            _full_at_once),
    sampled("ChargeMissing", "Carries no charge once in a hundred samples.", "state.ranges", "carries no charge",
            lambda robot, s: s._replace(battery=None) if counted(robot) % 100 == 0 else s),
    sampled("ChargeOff", "Reports a charge that is 5 % too high all along.", "truth.state.charge", "charge_off",
            lambda _, s: s._replace(battery=min((s.battery or 0.0) + 0.05, 1.0))),
    sampled("ChargeFloor", "Never reports less charge than 20 %.", "truth.state.charge", "charge_off",
            lambda _, s: s._replace(battery=max(s.battery or 0.0, 0.2))),
    sampled("IdleIsFree", "Counts what its motors take of the charge, and nothing at rest.", "truth.state.charge",
            "rested", _idle_free),
    sampled("PlacesWrap", "Wraps places at 33 m, as 16 bits of millimetres do.", "state.start", "origin|unit",
            lambda _, s: s._replace(x_m=(s.x_m + 32.768) % 65.536 - 32.768, y_m=(s.y_m + 32.768) % 65.536 - 32.768)),
    targeted("LeastSpeed", "Goes no slower than 0.1 m/s.", "goto.speed_cap", "low_speed_m_s",
             lambda _, to: to._replace(speed_m_s=None if to.speed_m_s is None else max(to.speed_m_s, 0.1))),
    edited("UpToSpeedFirst", "Stops, where it is gaining speed, once it is up to it.", "goal.cancel_early",
           "up to speed", _halt=_up_to_speed_first, _connect=with_control(_halts_when_fast)),
    edited("CutsCorners", "Drives in a curve to a goal that replaces another on the way.", "bounds.pivot", "curve",
           _connect=with_control(_curving)),
    edited("ServedLate", "Stops 0.25 s late while the other robot drives.", "several.both", "share",
           _halt=_served_late, _connect=_LATE["_connect"]),
    edited("Resumes", "Goes on with what was pre-empted once the new controller's goal is reached.",
           "authority.nothing_revived", "taken up again once", _hand_over=_resumes, _connect=with_control(_resuming)),
    sampled("Drifts", "Loses half a millimetre of its place in every metre.", "endurance.minute", "position_drift_m",
            _drifts),
    sampled("KeepsAll", "Keeps every sample that it ever heard.", "endurance.minute", "messages are kept", _keeps_all),
)  # fmt: skip

SELDOM_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("RestartsWithLongLease", "Has a lease of 1 s after a restart, which it was switched on with.",
           "deadman.restart", "longer than lease_s", restart=_forgets_its_lease),
    driven("GaugeBeginsAnew", "Says that it is full after a restart.", "deadman.restart", "gauge",
           restart=_gauge_anew, sample=_gauged),
    driven("BusyOnceAMinute", "Acts 60 ms late on one command in a minute.", "endurance.minute", "taken late",
           take=_busy_once_a_minute, control=_acting),
    wired("ReportsSeldomAtRest", "Reports three times a second at rest.", "state.age", "too seldom",
          _sample=lambda self: _seldom_at_rest(self)),
    driven("SlowClock", "Has a clock that is a thousandth slow.", "endurance.minute", "grown older",
           sample=lambda self, clock_s, *state: Vehicle.sample(self, 0.999 * clock_s, *state)),
)  # fmt: skip
