"""Adapters with what drivers of real robots get wrong: set too late, sent too seldom, rounded, kept, shared."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from soter.sdk import Controller, Goal, RobotSpec, RobotState, Waypoint
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import Exact, braking_at, memory, with_control
from tests.broken.seldom import State
from tests.conformance.channel import Faults
from tests.conformance.wire import Intent, Vehicle, WireRobot

_NEAR_M: Final = 0.15
_SOFTLY: Final = braking_at(0.5)


def _already_there(robot: Any, goal: Goal) -> None:
    i = robot._index
    if math.dist((robot._x[i], robot._y[i]), goal.target[:2]) > _NEAR_M:
        Broken._send_goto(robot, goal)


def _once(robot: Any, goal: Goal) -> None:
    last = memory(robot, "last place", lambda: [None])
    if goal.target != last[0]:
        last[0] = goal.target
        Broken._send_goto(robot, goal)


def _tenths(_: Any, to: Waypoint) -> Waypoint:
    return to if to.speed_m_s is None else to._replace(speed_m_s=int(to.speed_m_s * 10.0) / 10.0 or None)


def _a_goal_late(robot: Any, to: Waypoint) -> Waypoint:
    caps = memory(robot, "caps", lambda: [None])
    caps.append(to.speed_m_s)
    return to._replace(speed_m_s=caps.pop(0))


def _ramps_down(robot: Any, to: Controller) -> None:
    memory(robot, "soft", lambda: [False])[0] = to is not robot._mux.in_charge
    Broken._hand_over(robot, to)


def _softly(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    soft = memory(robot, "soft", lambda: [False])
    soft[0] = soft[0] and robot._mux.alive(state[0]) and abs(speed) < abs(state[4])
    return _SOFTLY(robot, state, speed, rate) if soft[0] else (speed, rate)


def _logs(robot: Any, goal: Goal) -> None:
    memory(robot, "logs", list).append(Path("/dev/null").open("rb"))  # noqa: SIM115 - that is what is wrong
    Broken._send_goto(robot, goal)


def _closes_logs(robot: Any, timeout_s: float) -> None:
    with suppress(KeyError):
        for each in robot.__dict__["kept"].pop("logs"):
            each.close()
    Broken._disconnect(robot, timeout_s)


def _averages(robot: Any, state: RobotState) -> RobotState:
    memory(robot, "all heard", list).append(state._replace())
    return state


def _last_good(robot: Any, state: RobotState) -> RobotState:
    good = memory(robot, "good", lambda: [1.0])
    if (state.battery or 0.0) >= 0.1:
        good[0] = state.battery
    return state._replace(battery=good[0])


def _filtered(robot: Any, state: RobotState) -> RobotState:
    kept = memory(robot, "filtered", lambda: [state.stamp_s, state.vx_m_s, state.vy_m_s])
    if state.stamp_s > kept[0]:
        kept[:] = state.stamp_s, 0.5 * (kept[1] + state.vx_m_s), 0.5 * (kept[2] + state.vy_m_s)
    return state._replace(vx_m_s=kept[1], vy_m_s=kept[2])


_LAST_SWITCHED: Final[dict[str, Controller]] = {}


def _answers_for_all(robot: Any, to: Controller) -> None:
    _LAST_SWITCHED["to"] = to
    Broken._hand_over(robot, to)


def _clamped(_: Any, to: Waypoint) -> Waypoint:
    """Turn clockwise from north by a remainder that keeps its sign, and send that without a sign."""
    if to.heading_rad is None:
        return to
    compass = max(0.0, math.fmod(math.pi / 2.0 - to.heading_rad, 2.0 * math.pi))
    return to._replace(heading_rad=math.pi / 2.0 - compass)


def _no_exponent(_: Any, state: RobotState) -> RobotState:
    """Read numbers as far as digits go."""
    numbers = {name: float(repr(getattr(state, name)).partition("e")[0]) for name in ("x_m", "y_m", "vx_m_s", "vy_m_s")}
    return state._replace(**numbers)  # type: ignore[arg-type]


def _numbered_in_16_bits(robot: Any, *arguments: Any) -> None:
    WireRobot.__init__(robot, *arguments)
    send = robot.down.send
    robot.down.send = lambda now_s, intent: send(now_s, intent._replace(number=intent.number & 0xFFFF))


def _resumes(robot: Any) -> RobotState | None:
    """Repeat what was said last, renewed, when the robot is heard again."""
    before, found = robot.latest, WireRobot._sample(robot)
    if before is not None and found is not None and found.stamp_s - before.stamp_s > 1.0:
        robot.want(renew=True)
    return found


_LINKS: Final[dict[int, list[Faults]]] = {}


def _in_turn(robot: Any) -> RobotState | None:
    """Wait 0.3 s for a robot that is silent before another one is heard."""
    now_s = robot.clock.now()
    waits = any(each.cut for each in _LINKS[id(robot.clock)] if each is not robot.faults)
    looked = memory(robot, "looked", lambda: [now_s])
    if waits and now_s - looked[0] < 0.3:
        return robot.latest  # type: ignore[no-any-return]
    looked[0] = now_s
    return WireRobot._sample(robot)


def _of_a_fleet(robot: Any, *arguments: Any) -> None:
    WireRobot.__init__(robot, *arguments)
    _LINKS.setdefault(id(robot.clock), []).append(robot.faults)


def _from_where_it_was_set_up(self: Any, clock_s: float, x_m: float, y_m: float, *rest: float) -> RobotState:
    off = memory(self, "odometry", lambda: [0.0, 0.0])
    return Vehicle.sample(self, clock_s, x_m + off[0], y_m + off[1], *rest)


def _odometry_anew(self: Any) -> None:
    bodies, start = self.world.bodies, memory(self, "set up", lambda: [0.0, 0.0])
    memory(self, "odometry", lambda: [0.0, 0.0])[:] = start[0] - bodies.x[self.index], start[1] - bodies.y[self.index]
    Vehicle.restart(self)


def _set_up(self: Any, spec: RobotSpec, world: Any) -> None:
    Vehicle.__init__(self, spec, world)
    memory(self, "set up", lambda: [spec.x_m, spec.y_m])


def _no_sooner(robot: Any, *arguments: Any) -> None:
    """Drop what is to be sent within 0.04 s of what was sent last."""
    WireRobot.__init__(robot, *arguments)
    send, last_s = robot.down.send, [-math.inf]

    def rarely(now_s: float, intent: Intent) -> None:
        if now_s - last_s[0] >= 0.04:
            last_s[0] = now_s
            send(now_s, intent)

    robot.down.send = rarely


def _short_ones(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.goal is None or intent.goal.target.heading_rad is None:
        Vehicle.take(self, intent, clock_s)


def _ac_headings(robot: Any, goal: Goal) -> None:
    to = goal.target if goal.by is Controller.AC else goal.target._replace(heading_rad=None)
    robot._mux.give(goal.by, Goal(robot, goal.id, to, goal.by, goal.sent_s), robot._world.now_s)


DRIVERS: Final[tuple[type[Broken], ...]] = (
    edited("AlreadyThere", "Takes a goal near where it is for reached, and goes on to the one before.",
           "goal.superseded", "goes on to the one before", _send_goto=_already_there),
    edited("SamePlaceOnce", "Sends a goal to the place of the last one no second time, whatever came between.",
           "goal.cancel", "taken for the same", _send_goto=_once),
    targeted("CapInTenths", "Cuts speed caps to tenths, and takes 0 for none.", "goto.speed_cap", "low_speed_m_s",
             _tenths),
    targeted("CapTooLate", "Keeps the speed cap of a goal for the next one.", "goto.speed_cap", "later goal",
             _a_goal_late),
    edited("SoftSwitch", "Brakes at half of what it promises at a switch, and well at all else.",
           "authority.effective", "after a switch", _hand_over=_ramps_down, _connect=with_control(_softly)),
    edited("LogsGoals", "Opens a file at each goal, and closes it with the robot.", "endurance.minute",
           "not closed", _send_goto=_logs, _disconnect=_closes_logs),
    sampled("AveragesAll", "Keeps every sample to average over.", "endurance.minute", "are kept", _averages),
    sampled("HeightDrifts", "Has a height that drifts by 2 mm a second, as by air pressure.", "deadman.wraps", "height",
            lambda _, s: s._replace(z_m=0.002 * s.stamp_s)),
    sampled("LastGoodCharge", "Keeps the last charge where the gauge gives none below 10 %.", "truth.state.charge",
            "old value", _last_good),
    sampled("TenBars", "Rounds the charge up to tenths.", "truth.state.charge", "rounded",
            lambda _, s: s._replace(battery=min(1.0, math.ceil(10.0 * (s.battery or 0.0)) / 10.0))),
    edited("Filtered", "Smooths its velocity.", "truth.bounds.velocity", "late", declared=Exact.declared,
           _sample=lambda self: _filtered(self, self._honest())),
    edited("AnswersForAll", "Reports for each robot who was put in charge last of any.", "several.switch",
           "taken for another's", _hand_over=_answers_for_all,
           _sample=lambda self: self._honest()._replace(controller=_LAST_SWITCHED["to"])),
    edited("HeadingsOfAcOnly", "Keeps headings of the AC's goals only.", "goto.heading", "of the SC",
           _send_goto=_ac_headings),
    sampled("NoExponent", "Reads no exponents, which small numbers have.", "state.frame", "misread", _no_exponent),
    targeted("NoQuadrant", "Cuts off headings that are negative once they are turned from north.", "goto.heading",
             "sign or zero", _clamped),
)  # fmt: skip


def _no_route(robot: Any, goal: Goal) -> None:
    if robot.latest is not None and robot.clock.now() - robot.latest.stamp_s > 1.0:
        raise ConnectionError("no route")
    WireRobot._send_goto(robot, goal)


DRIVERS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("SixteenBits", "Numbers its messages by sixteen bits.", "endurance.counters", "too few digits",
          __init__=_numbered_in_16_bits),
    wired("RenewsToResume", "Repeats and renews what it said last when the robot is heard again.",
          "link.revives_nothing", "once its link was back", _sample=_resumes),
    wired("HearsInTurn", "Waits 0.3 s for a robot that is silent before it hears the next.", "link.one_of_two",
          "wait for those", __init__=_of_a_fleet, _sample=_in_turn),
    wired("RaisesInSilence", "Raises an error of the system at a goto to a robot that is not heard.",
          "link.reconnects", "no route", _send_goto=_no_route),
    driven("OdometryAnew", "Says after a restart that it stands where it was set up first.", "deadman.restart",
           "odometry", __init__=_set_up, restart=_odometry_anew, sample=_from_where_it_was_set_up),
    wired("SendsRarely", "Drops a message that comes within 0.04 s of the one before.", "bounds.latency", "dropped",
          __init__=_no_sooner),
    driven("ShortOnes", "Reads no message that is long, such as a goal with a heading.", "goto.heading",
           "longer than what is read", take=_short_ones),
)  # fmt: skip
