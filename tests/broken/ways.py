"""Adapters with ways of their own to count, to share, to number and to say what robots do."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import Any, Final

from soter.onboard.mux import Mux
from soter.sdk import Controller, Goal, RobotState, Waypoint
from soter_sim import LIMITS
from tests.broken.edits import driven, edited, sampled, targeted, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import counted, memory, with_control
from tests.conformance.wire import Intent, Vehicle, WireRobot

_SLOW_M_S: Final = 0.15
_SOON_S: Final = 0.2
_GAINS_S: Final = 0.5
_REST_M_S: Final = 1e-3
_GENTLE_M_S2: Final = 0.5
_TOP_M_S: Final = LIMITS.v_max_m_s
_LIMITS: Final[dict[int, Any]] = {}


def _by_axis(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    most = _SLOW_M_S / max(abs(math.cos(state[3])), abs(math.sin(state[3])))
    return math.copysign(min(abs(speed), most), speed), rate


def _remembered(self: Any) -> RobotState:
    now = self._honest()
    past = memory(self, "past samples", lambda: [now, now])
    if now.stamp_s > past[1].stamp_s:
        past[:] = past[1], now
    return now  # type: ignore[no-any-return]


def _by_older_sample(robot: Any, to: Waypoint) -> Waypoint:
    """Drive the way that leads to a target from the place before."""
    now, old = robot._honest(), memory(robot, "past samples", lambda: [robot._honest()])[0]
    return to._replace(x_m=to.x_m + now.x_m - old.x_m, y_m=to.y_m + now.y_m - old.y_m)


def _between_reads(robot: Any, state: RobotState) -> RobotState:
    past = memory(robot, "read", lambda: [state])
    before, past[0] = past[0], state
    passed_s = state.stamp_s - before.stamp_s
    if passed_s <= 0.0:
        return state._replace(vx_m_s=0.0, vy_m_s=0.0)
    return state._replace(vx_m_s=(state.x_m - before.x_m) / passed_s, vy_m_s=(state.y_m - before.y_m) / passed_s)


def _limits_of_all(self: Any, spec: Any, clock: Any, world: Any) -> None:
    Broken.__init__(self, spec, clock, world)
    _LIMITS.clear()
    _LIMITS[0] = world.bodies.limits[self._index]


def _drives_as_all(self: Any, timeout_s: float) -> Any:
    self._drive_with(_LIMITS[0])
    return Broken._connect(self, timeout_s)


def _jerks_back(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Gain speed gently, but not where it moved the other way a moment ago."""
    went = memory(robot, "went", lambda: [0.0, -math.inf])
    is_m_s, ago_s = state[4], state[0] - went[1]
    turns = speed * went[0] < 0.0 and ago_s < _SOON_S
    if abs(is_m_s) > _REST_M_S and not (is_m_s * went[0] < 0.0 and ago_s < _GAINS_S and abs(is_m_s) < _SLOW_M_S):
        went[:] = [is_m_s, state[0]]
    if abs(speed) > abs(is_m_s) and not (turns or is_m_s * went[0] < 0.0):
        speed = math.copysign(min(abs(speed), abs(is_m_s) + _GENTLE_M_S2 * robot._world.period_s), speed)
    return speed, rate


def _notes_halts(self: Any) -> None:
    memory(self, "halted", list)[:] = [self._world.now_s]
    Broken._halt(self)


def _halts_last(self: Any, goal: Goal) -> None:
    if self._world.now_s not in memory(self, "halted", list):
        Broken._send_goto(self, goal)


class _Adds(Mux[Controller, Any]):
    """Lets every renewal add a lease to what is left."""

    __slots__ = ("ends_s",)

    def renew(self, now_s: float) -> None:
        self.ends_s = max(getattr(self, "ends_s", now_s), now_s) + self.lease_s

    def alive(self, now_s: float) -> bool:
        return now_s < getattr(self, "ends_s", -math.inf)


def _renewals_add_up(self: Any, *arguments: Any) -> None:
    Broken.__init__(self, *arguments)
    self._vehicle.mux = self._mux = _Adds(Controller.SC, self._mux.lease_s)


def _brakes_by_the_cap(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    most, goal = memory(robot, "cap", lambda: [_TOP_M_S]), robot._mux.command
    if goal is not None:
        most[0] = min(goal.target.speed_m_s or _TOP_M_S, _TOP_M_S)
    slowest = abs(state[4]) - most[0] / _TOP_M_S * LIMITS.brake_m_s2 * robot._world.period_s
    if goal is None and abs(speed) < slowest:
        speed = math.copysign(slowest, state[4])
    return speed, rate


WAYS: Final[tuple[type[Broken], ...]] = (
    edited("ByAxis", "Limits its speed along each axis by itself, so that a diagonal goes faster.", "goto.v_max",
           "diagonal", declared=replace(Broken.declared, v_max_m_s=_SLOW_M_S), _connect=with_control(_by_axis)),
    targeted("MovesBy", "Tells targets as ways from where it was a sample before.", "bounds.overshoot", "older sample",
             _by_older_sample, _sample=_remembered),
    sampled("BetweenReads", "Takes its velocity from one read to the next.", "state.velocity", "one read to the next",
            _between_reads),
    edited("LimitsOfTheLast", "Drives every robot by the limits of the one that was made last.",
           "truth.capabilities.asked", "counts for all", __init__=_limits_of_all, _connect=_drives_as_all),
    edited("JerksBack", "Gains speed faster where it turns from forwards to backwards.", "bounds.acceleration",
           "from forwards to backwards", declared=replace(Broken.declared, accel_m_s2=_GENTLE_M_S2),
           _connect=with_control(_jerks_back)),
    edited("HaltsLast", "Does in each period what it was told to drive to, and stops last.", "goal.cancel_own",
           "right behind a cancel", _halt=_notes_halts, _send_goto=_halts_last),
    edited("RenewalsAddUp", "Lets every renewal add a lease to what is left of it.", "deadman.lease", "add up",
           __init__=_renewals_add_up),
    sampled("WholePercent", "Says the charge in whole per cent, and takes none for unknown, which is full.",
            "state.nearly_flat", "another unit",
            lambda _, s: s._replace(battery=(round(100.0 * (s.battery or 0.0)) or 100) / 100.0)),
    sampled("AntennaAhead", "Says the place of an antenna 8 cm ahead of its middle.", "state.start", "antenna",
            lambda _, s: s._replace(x_m=s.x_m + 0.08 * math.cos(s.heading_rad),
                                    y_m=s.y_m + 0.08 * math.sin(s.heading_rad))),
    edited("BrakesByTheCap", "Brakes the more gently the lower the speed cap of its goal was.", "bounds.braking",
           "at half its speed", _connect=with_control(_brakes_by_the_cap)),
)  # fmt: skip


def _strangers_renew(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.session != self.session and self.mux.alive(clock_s):
        self.mux.renew(clock_s)
    Vehicle.take(self, intent, clock_s)


def _single(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.renewed_s is not None:
        intent = intent._replace(renewed_s=struct.unpack("f", struct.pack("f", intent.renewed_s))[0])
    Vehicle.take(self, intent, clock_s)


def _by_beginning(self: Any, *, renew: bool = False, **changes: Any) -> None:
    WireRobot.want(self, renew=renew, **changes)
    for control in self.vehicle.world.bodies.control:
        other = getattr(control, "__self__", None)
        if isinstance(other, Vehicle) and other.id != self.id and str(self.id).startswith(str(other.id)):
            other.take(self.wanted, other.world.now_s + other.offset_s)


def _old_place(self: Any) -> RobotState | None:
    before, found = memory(self, "before", lambda: [None]), WireRobot._sample(self)
    if found is not None and (before[0] is None or found.stamp_s > before[0].stamp_s):
        old, before[0] = before[0], found
        if old is not None and counted(self, "samples") % 25 == 0:
            before[0] = found._replace(x_m=old.x_m, y_m=old.y_m)
    return before[0]  # type: ignore[no-any-return]


def _echoed(self: Any) -> RobotState | None:
    found = WireRobot._sample(self)
    return None if found is None else found._replace(controller=self.wanted.in_charge)


def _inherits(self: Any, intent: Intent, clock_s: float) -> None:
    left = self.mux.command
    if intent.session != self.session and self.follows(intent, clock_s):
        memory(self, "left", list)[:] = [left]
    Vehicle.take(self, intent, clock_s)
    if intent.goal is not None:
        memory(self, "left", list).clear()
    elif intent.session == self.session:
        # Nobody has told it to drop that.
        self.mux.command = next(iter(memory(self, "left", list)), None)


WAYS_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("StrangersRenew", "Renews the lease with what a program says that it does not follow.",
           "authority.one_program", "renews the lease of the first", take=_strangers_renew),
    driven("SinglePrecision", "Reads when leases were renewed as floats of 32 bits.", "deadman.wraps",
           "too few digits", take=_single),
    wired("HeardByBeginning", "Has robots hear what is for one whose name begins with their own.", "several.chosen",
          "name begins with", want=_by_beginning),
    wired("Echoes", "Reports who it put in charge, and not what the robot says.", "link.delay", "what was sent",
          _sample=_echoed),
    driven("HeirToTheGoal", "Takes up the goal of a program that died when the next one renews.",
           "authority.one_program", "ends with it", take=_inherits),
    wired("OldPlace", "Has the place of the sample before in one of 25, stamped anew.", "truth.bounds.noise",
          "stamps newer", _sample=_old_place),
)  # fmt: skip
