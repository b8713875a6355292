"""Adapters in process that neglect one of their duties, by small edits."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from soter.errors import SoterError
from soter.sdk import Controller, GoalStatus, RobotState, Waypoint
from tests.broken.edits import edited, sampled, targeted
from tests.broken.in_process import Broken
from tests.broken.parts import (
    FIRST,
    ago,
    counted,
    memory,
    with_control,
)


def _calls_also(name: str, also: Callable[[Any], object]) -> Callable[..., None]:
    """Return a hook that does one thing more."""

    def call(self: Any, *arguments: Any) -> None:
        getattr(Broken, name)(self, *arguments)
        also(self)

    return call


def _hand_over_lost(every: int, *, reported: bool) -> dict[str, Callable[..., Any]]:
    """Return hooks that lose one hand-over of so many, once robots are ready."""

    def hand_over(self: Any, to: Controller) -> None:
        if counted(self, "handed") % every:
            Broken._hand_over(self, to)
            memory(self, "said", lambda: [to])[0] = to
        elif reported:
            self._mux.in_charge = to

    return {"_hand_over": hand_over}


def _switched_late(seconds: float) -> dict[str, Callable[..., Any]]:
    """Return hooks that report a hand-over at once, and let the old target live on for a while."""

    def hand_over(self: Any, to: Controller) -> None:
        old = self._mux.command
        Broken._hand_over(self, to)
        if old is not None:
            self._mux.command = old
            memory(self, "ends", lambda: [0.0, None])[:] = [self._world.now_s + seconds, old]

    def edit(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
        ends_s, old = memory(self, "ends", lambda: [math.inf, None])
        if state[0] + 1e-6 >= ends_s and self._mux.command is old:
            self._mux.command = None
            return 0.0, 0.0
        return speed, rate

    return {"_hand_over": hand_over, "_connect": with_control(edit)}


def _renews(self: Any) -> None:
    self._mux.renew(self._world.now_s)


def _says_failed(self: Any, *arguments: Any) -> Any:
    found = Broken.read_state(self, *arguments)
    for goal in memory(self, "sent", list):
        goal.status = GoalStatus.FAILED if goal.status is GoalStatus.TIMED_OUT else goal.status
    return found


def _remembers(self: Any, goal: Any) -> None:
    memory(self, "sent", list).append(goal)
    Broken._send_goto(self, goal)


def _reads(self: Any) -> None:
    with suppress(SoterError):
        self.read_state()


def _raise(robot: Any) -> None:
    raise RuntimeError(f"robot {robot.id} was closed already")


def _forgets_its_goal(robot: Any, timeout_s: float) -> None:
    robot._Robot__goal = None
    Broken.close(robot, timeout_s)


def _coasting(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    if self._mux.command is not None and self._mux.passing(state[0]) is None:
        slowest = abs(state[4]) - 0.3 * self._world.period_s
        speed = math.copysign(max(abs(speed), slowest), state[4]) if slowest > abs(speed) else speed
    return speed, rate


def _at_the_edge(robot: Any, target: Waypoint) -> Waypoint:
    at = robot._honest()
    dx, dy = target.x_m - at.x_m, target.y_m - at.y_m
    share = max(target.radius_m - 0.005, 0.0) / max(math.hypot(dx, dy), 0.01)
    return target._replace(x_m=target.x_m - share * dx, y_m=target.y_m - share * dy)


def _few_gotos(self: Any, goal: Any) -> None:
    if counted(self, "gotos") < 150:
        Broken._send_goto(self, goal)


def _stops_forwards(self: Any) -> None:
    if self._v[self._index] > -0.05:
        Broken._halt(self)


_DEAF_S: Final = 0.2


def _deafens(self: Any, to: Controller) -> None:
    Broken._hand_over(self, to)
    self.deaf_s = self._world.now_s + _DEAF_S


def _deaf_control(self: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    return (0.0, 0.0) if state[0] < getattr(self, "deaf_s", 0.0) else (speed, rate)


def _indexed(index: Callable[[int, int], int]) -> Callable[..., None]:
    """Return an `__init__` by which a robot's place in the list comes of its id and how many there are."""

    def begin(self: Any, *arguments: Any) -> None:
        Broken.__init__(self, *arguments)
        self._index = index(self.id, len(self._v))

    return begin


def _flushes_again(self: Any, to: Controller) -> None:
    self._mux.halt()
    Broken._hand_over(self, to)


def _smoothed(robot: Any, state: RobotState) -> RobotState:
    """Return a sample with a charge that follows the real one in a minute."""
    kept = memory(robot, "charge", lambda: [state.battery, state.stamp_s])
    kept[0] += (state.battery - kept[0]) * min((state.stamp_s - kept[1]) / 60.0, 1.0)
    kept[1] = state.stamp_s
    return state._replace(battery=kept[0])


def _resting(robot: Any, state: RobotState) -> RobotState:
    """Return the last sample again, but for twice a second, once it has rested for 3 s."""
    kept = memory(robot, "resting", lambda: [state, state.stamp_s])
    if math.hypot(state.vx_m_s, state.vy_m_s) > 1e-3 or abs(state.yaw_rate_rad_s) > 1e-3:
        kept[1] = state.stamp_s
    elif state.stamp_s - kept[1] > 3.0 and state.stamp_s - kept[0].stamp_s < 0.5:
        return kept[0]  # type: ignore[no-any-return]
    kept[0] = state
    return state


def _one_behind(robot: Any, state: RobotState) -> RobotState:
    """Return the sample that was due at the read before."""
    kept = memory(robot, "behind", lambda: [state, state])
    if state is not kept[1]:
        kept[:] = kept[1], state
    return kept[0]  # type: ignore[no-any-return]


DUTIES: Final = (
    edited("IndexByNumber", "Takes a robot's number for its place in the list.", "several.ids",
           "another robot's", __init__=_indexed(lambda number, many: (number - 1) % many)),
    edited("IndexFromOne", "Takes a robot's number for its place in the list, and has no such place.", "lifecycle.init",
           "id taken for an index", __init__=_indexed(lambda number, _: number - 1)),
    edited("FlushedAgain", "Flushes the goal of the controller in charge when its hand-over is sent again.",
           "authority.idempotent", "that one's own goal", _hand_over=_flushes_again),
    sampled("ChargeSmoothed", "Follows the charge in a minute.", "several.charge", "lags behind", _smoothed),
    sampled("FirstOld", "Queues samples of the first of two robots.", "several.second", f"of robot {FIRST} queue",
            lambda r, s: ago(r, s, 6) if r.id == FIRST and len(r._v) > 1 else s),
    sampled("OldAtRest", "Reports twice a second after 3 s of rest.", "authority.alternations", "report is old",
            _resting),
    sampled("OneBehind", "Hands out the sample that was due at the read before.", "goal.written_in_read_state",
            "at the one before", _one_behind),
    edited("CoastsOnLease", "Coasts when its lease ends, and brakes well at a cancel.", "deadman.lease", "lease|brake",
           _connect=with_control(_coasting)),
    edited("OthersCharge", "Reports the first robot's charge for the second.", "several.charge", "charge of the other",
           _sample=lambda self: self._honest()._replace(battery=self._world.bodies.charge[0])),
    sampled("HeadingLags", "Hands out headings of 0.3 s ago.", "truth.bounds.noise", "heading",
            lambda r, s: s._replace(heading_rad=ago(r, s, 6).heading_rad)),
    sampled("TurnLags", "Hands out turn rates of 0.4 s ago.", "state.yaw_rate", "too low",
            lambda r, s: s._replace(yaw_rate_rad_s=ago(r, s, 8).yaw_rate_rad_s)),
    sampled("GridOfFive", "Rounds positions to 5 cm.", "truth.bounds.noise", "position_noise_m",
            lambda _, s: s._replace(x_m=round(20.0 * s.x_m) / 20.0, y_m=round(20.0 * s.y_m) / 20.0)),
    targeted("StopsAtTheEdge", "Stops at the edge of a goal's radius.", "goto.holds",
           "edge of the radius", _at_the_edge),
    edited("FewGotos", "Takes 150 gotos and no more.", "goto.flood", "older target|right way", _send_goto=_few_gotos),
    edited("StopsForwards", "Stops only while it drives forwards.", "goal.cancel", "backwards", _halt=_stops_forwards),
    edited("DeafAfterSwitch", "Does nothing for 0.2 s after a switch.", "authority.obeys_at_once", "deaf",
           _hand_over=_deafens, _connect=with_control(_deaf_control)),
    edited("SlowToTheLeft", "Turns to the left at half its rate.", "bounds.yaw_rate", "to one side",
           _connect=with_control(lambda _, state, v, w: (v, 0.5 * w if w > 0.0 else w))),
    edited("Creeps", "Creeps at 4 mm/s where it should rest.", "goto.holds", "creeps",
           _connect=with_control(lambda _, state, v, w: (0.004 if v == 0.0 and abs(w) < 0.01 else v, w))),
    edited("CancelRenews", "Renews the lease with a cancel.", "deadman.cancel", "cancel", _halt=_calls_also("_halt",
            _renews)),
    edited("HandOverRenews", "Renews the lease with a hand-over.", "deadman.hand_over", "_hand_over",
           _hand_over=_calls_also("_hand_over", _renews)),
    edited("OneHandOverInFifty", "Loses one hand-over in fifty.", "authority.alternations", "lost",
            **_hand_over_lost(50, reported=False)),
    edited("OneFlushInFifty", "Reports every hand-over, and one in fifty flushes nothing.", "authority.effective",
            "lost",
           **_hand_over_lost(51, reported=True)),
    edited("AcknowledgedEarly", "Reports a hand-over 0.15 s before it is effective, within its latency.",
           "authority.effective", "reported before", declared=replace(Broken.declared, latency_s=0.17),
            **_switched_late(0.15)),
    edited("HandOverTenthLate", "Hands over 0.1 s late, and says so at once.", "authority.effective", "latency",
           **_switched_late(0.1)),
    edited("FlushesOneWay", "Flushes when the AC takes over only.", "authority.flushes", "old controller",
           _hand_over=lambda self, to: Broken._hand_over(self, to) if to is Controller.AC else setattr(self._mux,
            "in_charge", to)),
    edited("CancelStopsBoth", "Stops every robot with any cancel.", "several.cancel", "broadcast",
           _all=[], _connect=lambda self, timeout_s: (self._all.append(self), Broken._connect(self, timeout_s))[1],
           _halt=lambda self: [each._mux.halt() for each in self._all if each._world is self._world]),
    edited("TimesOutFailed", "Says FAILED for timed out.", "goal.timeout", "time-out", read_state=_says_failed,
           _send_goto=_remembers),
    edited("StartsWithAc", "Begins with the AC in charge.", "lifecycle.init", "in charge",
           _hand_over=lambda self, to: self._mux.switch(to if counted(self, "handed") > 1 else Controller.AC)),
    edited("InitTwice", "Takes a second init().", "lifecycle.init_twice", "raised nothing",
           init=lambda self, timeout_s: None if counted(self, "inits") > 1 else Broken.init(self, timeout_s)),
    edited("CloseRaises", "Raises when it is closed a second time.", "lifecycle.close_twice", "closed",
           close=lambda self, timeout_s: (
               _raise(self) if counted(self, "closes") > 1 else Broken.close(self, timeout_s)
           )),
    edited("LivesOn", "Still takes gotos after close().", "lifecycle.after_close", "raised nothing",
           _Robot__require_ready=lambda self, call: None),
    edited("GoalsLiveOn", "Leaves its goal active when it is closed.", "lifecycle.close_ends_goals", "close",
           close=_forgets_its_goal),
    edited("JudgedOnRenewal", "Judges goals when the lease is renewed.", "goal.written_in_read_state",
            "besides read_state",
           _renew_lease=_calls_also("_renew_lease", _reads)),
)  # fmt: skip
