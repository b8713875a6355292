"""Adapters that go wrong after a while, after much of something, towards one side, or in one of many; a line each."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from soter.sdk import Controller, Goal, RobotState, Waypoint
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import Exact, acting_late, ago, braking_at, counted, memory, with_control
from tests.broken.wire_mutants import _sample_edit
from tests.conformance.wire import Intent, Vehicle

State = tuple[float, ...]
"""What a control is called with: now_s, x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s."""

_BITS_S: Final = 65.536
_CREEP_M_S: Final = 0.1
_LONG_S: Final = 3.0
_FAR_M: Final = 15.0
_MUCH_RAD: Final = 50.0
_BUMP_S: Final = 0.6
_GRACE_S: Final = 10.0
_LATE: Final = acting_late(3)


def _summed(robot: Any, name: str, by: float) -> float:
    """Add to what a robot has done of something, and return it."""
    done = memory(robot, name, lambda: [0.0])
    done[0] += abs(by) * robot._world.period_s
    return float(done[0])


def _age_begins_anew(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    age_s = state[0] + robot._world.period_s - robot._mux._renewed_s
    if _BITS_S <= age_s < math.inf:
        robot._mux._renewed_s += _BITS_S
    return speed, rate


def _creeping_is_safe(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    if goal is not None and (goal.target.speed_m_s or math.inf) < _CREEP_M_S:
        robot._mux.renew(state[0])
    return speed, rate


def _sets_out(robot: Any, goal: Goal) -> None:
    memory(robot, "set out", lambda: [0.0])[0] = robot._world.now_s
    Broken._send_goto(robot, goal)


def _halts_late(robot: Any) -> None:
    long = robot._world.now_s - memory(robot, "set out", lambda: [0.0])[0] > _LONG_S
    (_LATE["_halt"] if long else Broken._halt)(robot)


def _brakes_wear(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    worn = _summed(robot, "way", state[4]) > _FAR_M
    return braking_at(0.7)(robot, state, speed, rate) if worn else (speed, rate)


def _tires(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    return speed, 0.5 * rate if _summed(robot, "turned", state[5]) > _MUCH_RAD else rate


def _gyro(robot: Any, state: RobotState) -> RobotState:
    seen = memory(robot, "gyro", lambda: [state.stamp_s])
    if state.stamp_s > seen[0]:
        seen[0] = state.stamp_s
        _summed(robot, "turned", state.yaw_rate_rad_s)
    off_rad = 0.04 if _summed(robot, "turned", 0.0) > _MUCH_RAD else 0.0
    return state._replace(heading_rad=math.pi - (math.pi - state.heading_rad - off_rad) % (2.0 * math.pi))


def _pulled(_robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    return speed, rate + 0.5 if 0.5 < state[3] < 1.2 and speed > 0.0 else rate


def _charge_at_rest(robot: Any, state: RobotState) -> RobotState:
    kept = memory(robot, "at rest", lambda: [state.battery])
    if math.hypot(state.vx_m_s, state.vy_m_s) + abs(state.yaw_rate_rad_s) < 1e-3:
        kept[0] = state.battery
    return state._replace(battery=kept[0])


def _charge_as_at_rest(robot: Any, state: RobotState) -> RobotState:
    """Round the charge down, and sink to a lower one as slowly as at rest."""
    said = math.floor(state.battery * 100.0) / 100.0 if state.battery is not None else 0.0
    kept = memory(robot, "sinks", lambda: [said, state.stamp_s])
    kept[:] = max(said, kept[0] - (state.stamp_s - kept[1]) / robot.spec.idle_s), state.stamp_s
    return state._replace(battery=kept[0])


def _waits_for_speed_only(self: Any, timeout_s: float) -> None:
    self._mux.revoke()
    while abs(self._v[self._index]) > 1e-3:
        self.clock.sleep_until(self.clock.now() + self._world.period_s)


def _backs_off(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    bumps = memory(robot, "bumps", lambda: [0, -math.inf])
    contacts = robot._world.truth.report().contacts
    if contacts > bumps[0]:
        bumps[:] = contacts, state[0] + _BUMP_S
    return (-0.2, 0.0) if state[0] < bumps[1] else (speed, rate)


def _hands_over(robot: Any, to: Controller) -> None:
    if to is not robot._mux.in_charge:
        memory(robot, "handed over", list)[:] = [robot._world.now_s]
    Broken._hand_over(robot, to)


def _lost_with_it(robot: Any, goal: Goal) -> None:
    with_it = robot._world.now_s in memory(robot, "handed over", list)
    if not with_it or counted(robot, "with it") % 40:
        Broken._send_goto(robot, goal)


def _of_before(robot: Any, target: Waypoint) -> Waypoint:
    kept = memory(robot, "target", lambda: [target])
    before, kept[0] = kept[0], target
    return before if counted(robot) % 100 == 0 else target


def _oversleeps(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    sleep, period_s = self.clock.sleep_until, self._world.period_s
    if not hasattr(sleep, "__wrapped__"):

        def oversleep(until_s: float) -> None:
            sleep(until_s + period_s * (counted(self, "slept") % 200 == 0))

        oversleep.__wrapped__ = sleep  # type: ignore[attr-defined]
        self.clock.sleep_until = oversleep


def _begins_with_long_lease(self: Vehicle) -> None:
    Vehicle.restart(self)
    self.mux.lease_s = 1.0
    memory(self, "on since", list)[:] = [self.world.now_s]


def _sets_lease(self: Vehicle, intent: Intent, clock_s: float) -> None:
    since = memory(self, "on since", list)
    if since and self.world.now_s - since[0] > _GRACE_S:
        self.mux.lease_s = self.lease_s
    Vehicle.take(self, intent, clock_s)


def _velocity_ago(robot: Any, state: RobotState) -> RobotState:
    old = ago(robot, state, 2)
    return state._replace(vx_m_s=old.vx_m_s, vy_m_s=old.vy_m_s)


def _watched_once(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Stop at the end of the lease once for each goal, until it is renewed; drive on at the next one."""
    goal, now_s, watch = robot._mux.command, state[0], memory(robot, "watch", lambda: [None, True, False])
    if goal is not None and goal is not watch[0]:
        watch[:] = goal, True, False
    if robot._mux.alive(now_s):
        watch[2] = False
    elif watch[1]:
        watch[1:] = False, True
    if robot._mux.alive(now_s) or watch[2] or goal is None:
        return speed, rate
    return robot._vehicle._drive.command(*state[1:], goal.target)  # type: ignore[no-any-return]


def _notes_arrival(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    goal = robot._mux.command
    if goal is not None and math.dist(state[1:3], goal.target[:2]) <= goal.target.radius_m:
        memory(robot, "reached", lambda: [None])[0] = goal.target[:2]
    return speed, rate


def _has_been_there(robot: Any, goal: Goal) -> None:
    if memory(robot, "reached", lambda: [None])[0] != goal.target[:2]:
        Broken._send_goto(robot, goal)
    elif robot._mux.command is None or robot._mux.command.target[:2] != goal.target[:2]:
        robot._mux.halt()


def _notes_time_out(robot: Any, goal: Goal) -> None:
    aborted = memory(robot, "aborted", lambda: [False, math.inf])
    skips, aborted[:] = aborted[0], (False, goal.deadline_s)
    if not skips:
        Broken._send_goto(robot, goal)


def _aborts(robot: Any) -> None:
    aborted = memory(robot, "aborted", lambda: [False, math.inf])
    aborted[0] = robot._now() >= aborted[1]
    Broken._halt(robot)


AFTERWARDS: Final[tuple[type[Broken], ...]] = (
    edited("AgeOfSixteenBits", "Counts how old its lease is by milliseconds in 16 bits.", "deadman.stays",
           "too few digits", _connect=with_control(_age_begins_anew)),
    edited("CreepingIsSafe", "Heeds no lease where a goal's speed is below 0.1 m/s.", "deadman.reading", "low speed",
           _connect=with_control(_creeping_is_safe)),
    edited("LateAfterAWhile", "Stops 0.15 s late once it has driven to a goal for 3 s.", "bounds.long_tube",
           "long_stop_s", _connect=_LATE["_connect"], _send_goto=_sets_out, _halt=_halts_late),
    edited("BrakesWear", "Brakes at 70 % of what it promises once it has driven 15 m.", "endurance.minute",
           "tired_brake_m_s2", _connect=with_control(_brakes_wear)),
    edited("Tires", "Turns at half its rate once it has turned by 50 rad in all.", "endurance.minute",
           "after much turning", _connect=with_control(_tires)),
    sampled("GyroDrifts", "Says headings that are 0.04 rad off once it has turned by 50 rad in all.",
            "endurance.minute", "heading_drift_rad", _gyro),
    edited("PulledAside", "Is pulled to the left where it heads to the north-east.", "truth.bounds.tube", "pulled off",
           _connect=with_control(_pulled)),
    sampled("ChargeAtRest", "Measures its charge at rest only.", "truth.state.charge", "without a rest",
            _charge_at_rest),
    sampled("SinksAsAtRest", "Sinks to a lower charge no faster than at rest.", "truth.state.discharge",
            "drives on and on", _charge_as_at_rest),
    edited("ClosesTurning", "Waits at its close until it does not drive any more, and may turn.",
           "truth.lifecycle.close_stops", "rad in the second", _disconnect=_waits_for_speed_only),
    edited("BacksOff", "Backs off by itself where it touches something.", "truth.bounds.body", "bumper",
           _connect=with_control(_backs_off)),
    edited("LostWithHandOver", "Loses one in 40 of the goals that are sent right behind a hand-over.",
           "authority.alternations", "sent together", _hand_over=_hands_over, _send_goto=_lost_with_it),
    targeted("TargetOfBefore", "Drives to the target of the goal before once in a hundred goals.", "goal.cancels",
             "one of many goals", _of_before),
    edited("WatchedOnce", "Heeds the end of its lease once a goal, and not after a renewal.", "deadman.recovers",
           "works once", _connect=with_control(_watched_once)),
    edited("HasBeenThere", "Takes a goal to where it has been last for reached, wherever it is by now.",
           "goal.superseded", "wherever the robot is by now", _connect=with_control(_notes_arrival),
           _send_goto=_has_been_there),
    edited("AbortsTheNext", "Throws the goal behind one that timed out away.", "goal.timeout",
           "behind one that timed out", _send_goto=_notes_time_out, _halt=_aborts),
    edited("Oversleeps", "Wakes a period late once in 200 ticks.", "bounds.jitter", "jitter_rare_s",
           __init__=_oversleeps),
    edited("VelocityAgo", "Hands out velocities of two samples ago.", "state.velocity", "earlier sample",
           declared=replace(Exact.declared, speed_noise_m_s=None),
           _sample=lambda self: _velocity_ago(self, self._honest())),
)  # fmt: skip

AFTERWARDS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("LongLeaseAtFirst", "Has a lease of 1 s for 10 s after a restart.", "deadman.restart", "longer than lease_s",
           restart=_begins_with_long_lease, take=_sets_lease),
    wired("VelocityAgo", "Hands out velocities of two samples ago.", "state.velocity", "earlier sample",
          _sample=_sample_edit(_velocity_ago)),
)  # fmt: skip
