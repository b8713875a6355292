"""Adapters whose robots do what nobody asks for any more, or not what is asked for now; one line of a table each."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.sdk import Controller, Goal
from soter_sim import LIMITS
from tests.broken.afterwards import State
from tests.broken.edits import driven, edited, sampled
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import memory, with_control
from tests.conformance.wire import Vehicle

_PLANS_EVERY_S: Final = 0.2
_SLOW_M_S: Final = 0.005
_ROUNDING: Final = 1e-6
_GRACE_S: Final = 0.5
_BOUNCES_S: Final = 0.3
_STRIKES: Final = 3
_ONE_MAH: Final = 0.0004


def _planned(robot: Any, goal: Goal | None, now_s: float, speed_m_s: float) -> Goal | None:
    """Return what is driven to: on its way to one goal it takes the next one up where a cycle begins."""
    planned = memory(robot, "planned", lambda: [None])
    waits = goal is not None and planned[0] is not None and planned[0].by is goal.by and abs(speed_m_s) > _SLOW_M_S
    if not waits or (now_s + _ROUNDING) % _PLANS_EVERY_S < 2.0 * _ROUNDING:
        planned[0] = goal
    return planned[0]  # type: ignore[no-any-return]


def _in_cycles(self: Any, timeout_s: float) -> Any:
    found, vehicle = Broken._connect(self, timeout_s), self._vehicle

    def control(now_s: float, *state: float) -> tuple[float, float]:
        goal = _planned(self, vehicle.mux.passing(now_s), now_s, state[3])
        return vehicle._drive.command(*state, None if goal is None else goal.target)  # type: ignore[no-any-return]

    self._world.set_control(self.id, control)
    return found


def _passing_in_cycles(self: Any, clock_s: float) -> Goal | None:
    return _planned(self, Vehicle.passing(self, clock_s), self.world.now_s, self.world.bodies.v[self.index])


def _begins_its_grace(robot: Any, to: Controller) -> None:
    if robot._mux.switch(to):
        memory(robot, "grace", lambda: [0.0])[0] = robot._world.now_s + _GRACE_S


def _graceful(self: Any, timeout_s: float) -> Any:
    """Ask for no lease for half a second after a hand-over."""
    found, vehicle = Broken._connect(self, timeout_s), self._vehicle

    def control(now_s: float, *state: float) -> tuple[float, float]:
        goal = vehicle.mux.passing(now_s)
        if now_s < memory(self, "grace", lambda: [0.0])[0]:
            goal = vehicle.mux.command
        return vehicle._drive.command(*state, None if goal is None else goal.target)  # type: ignore[no-any-return]

    self._world.set_control(self.id, control)
    return found


def _passing_gracefully(self: Any, clock_s: float) -> Goal | None:
    lives_until = memory(self, "grace", lambda: [self.mux.in_charge, 0.0])
    if self.mux.in_charge is not lives_until[0]:
        lives_until[:] = self.mux.in_charge, clock_s + _GRACE_S
    passing: Goal | None = self.mux.passing(clock_s)
    return self.mux.command if clock_s < lives_until[1] else passing


def _saves(robot: Any, goal: Goal) -> None:
    Broken._send_goto(robot, goal)
    memory(robot, "sent", lambda: [None])[0] = goal


def _says_it_all_again(robot: Any, to: Controller) -> None:
    """Send the last message again where nobody else takes over, with the goal that was in it."""
    sent = memory(robot, "sent", lambda: [None])
    if to is not robot._mux.in_charge:
        sent[0] = None
    Broken._hand_over(robot, to)
    if sent[0] is not None:
        Broken._send_goto(robot, sent[0])


def _keeps_its_task(robot: Any, left: float, right: float, brake: float, alive: bool) -> None:
    """Keep the goal while the motors are off; who is in charge begins anew."""
    kept = robot._mux.command
    SimulatedRobot.impair(robot, left, right, brake, alive)
    robot._mux.command = kept


def _forgets_its_speed(robot: Any, left: float, right: float, brake: float, alive: bool) -> None:
    """Have the top speed of its kind once the motors are on again, in its drive and in the motors themselves."""
    SimulatedRobot.impair(robot, left, right, brake, alive)
    if alive:
        engine, at = robot._world.engine, robot._index
        robot._drive_with(replace(robot._world.bodies.limits[at], v_max_m_s=LIMITS.v_max_m_s))
        index, _, *rest = engine._each[at]
        vars(engine)["_each"] = (*engine._each[:at], (index, LIMITS.v_max_m_s, *rest), *engine._each[at + 1 :])


def _stops_seldom(robot: Any) -> None:
    stopped, now_s = memory(robot, "stopped", lambda: [-math.inf]), robot._world.now_s
    if now_s - stopped[0] >= _BOUNCES_S:
        stopped[0] = now_s
        Broken._halt(robot)


def _latches(robot: Any, state: State, speed: float, rate: float) -> tuple[float, float]:
    """Stand for ever once the lease has ended three times on the way to a goal."""
    driven, ends = memory(robot, "driven", lambda: [False]), memory(robot, "ends", list)
    passes = robot._mux.passing(state[0]) is not None
    if driven[0] and not passes and robot._mux.command is not None:
        ends.append(state[0])
    driven[0] = passes
    return (0.0, 0.0) if len(ends) >= _STRIKES else (speed, rate)


def _sends_each_id_once(robot: Any, goal: Goal) -> None:
    """Send no goal with the number of the last one that any robot was sent."""
    last = vars(robot.clock).get("last_sent")
    vars(robot.clock)["last_sent"] = goal.id
    if goal.id != last:
        Broken._send_goto(robot, goal)


UNASKED: Final[tuple[type[Broken], ...]] = (
    edited("PlansInCycles", "Takes up a goal that replaces another on its way in the next of cycles of 0.2 s.",
           "goal.replaced", "cycles that are longer", _connect=_in_cycles),
    edited("GraceAfterHandOver", "Asks for no lease for 0.5 s after a hand-over.", "deadman.hand_over",
           "given time to begin", _hand_over=_begins_its_grace, _connect=_graceful),
    edited("SaysItAllAgain", "Sends a hand-over again with the goal that was sent last, cancelled or not.",
           "authority.nothing_revived", "brings back the goal that was cancelled", _send_goto=_saves,
           _hand_over=_says_it_all_again),
    edited("KeepsItsTask", "Keeps its goal when its motors are switched off and on.", "deadman.off_and_on",
           "outlives the power", impair=_keeps_its_task),
    edited("SpeedLostWithThePower", "Goes as fast as its kind, whatever it was asked for, once its motors were off.",
           "truth.capabilities.asked", "lost with the power", impair=_forgets_its_speed),
    sampled("ChargeBelowNothing", "Counts what is left of its charge in a number that has no sign, and goes below 0.",
            "state.emptying", "goes below 0",
            lambda _, state: state._replace(battery=24.3) if (state.battery or 0.0) < _ONE_MAH else state),
    edited("BouncingStops", "Takes a stop within 0.3 s of the last one for its repetition.", "goal.cancel_early",
           "repetition of the cancel", _halt=_stops_seldom),
    edited("LatchesAFault", "Stands for ever once its lease has ended three times on its way.", "deadman.lease",
           "latched a fault", _connect=with_control(_latches)),
    edited("EachIdOnce", "Sends no goal that has the number of the last one, of whichever robot.", "several.goto",
           "count anew for each", _send_goto=_sends_each_id_once),
)  # fmt: skip

UNASKED_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    driven("PlansInCycles", "Takes up a goal that replaces another on its way in the next of cycles of 0.2 s.",
           "goal.replaced", "cycles that are longer", passing=_passing_in_cycles),
    driven("GraceAfterHandOver", "Asks for no lease for 0.5 s after a hand-over.", "deadman.hand_over",
           "given time to begin", passing=_passing_gracefully),
)  # fmt: skip
