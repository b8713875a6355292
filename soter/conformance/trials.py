"""Many cheap trials of one kind: a robot gets going and comes to rest, again and again, on one straight way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import cycle
from statistics import median
from typing import Final, NamedTuple

from soter.conformance.bench import Bench
from soter.conformance.driver import TICK_S
from soter.conformance.track import CRUISE_S, Ramp, fit_start, fit_stop, reaction_s, run_m
from soter.errors import Unsupported
from soter.sdk import Controller, Goal, Robot, Waypoint

_END: Final = 0.85
_BACK: Final = 0.3
_ENOUGH: Final = 3
_TURNS_AT: Final = 0.8
GOLDEN: Final = 0.618
"""Multiples of this, without their whole parts, are spread evenly, however many there are."""

_ODD_TICKS: Final = 4
_REST_S: Final = 0.25
_TAIL_S: Final = 0.2
_LONGEST_REST_S: Final = 4.0
_SHARE_IN_PROCESS: Final = 0.02
_SHARE: Final = 0.08
_VOID: Final = 2


class Trial(NamedTuple):
    """One trial: how the robot got going after a goto, forwards or backwards, and how it came to rest when told to."""

    start: Ramp
    end: Ramp
    called_s: float
    backwards: bool


def measure_braking(
    bench: Bench, trials: Sequence[Trial], what: str, name: str = "brake_m_s2", blur: float = 1.0
) -> None:
    """Judge how hard a robot braked, in each trial from its first deceleration on.

    Forwards and backwards are judged apart; on a wire, where single trials are less exact, only with enough of each.

    Args:
        bench: the bench of the trials.
        trials: the trials.
        what: the cause of the stop, in words.
        name: the figure's name.
        blur: how many times larger the error is than from full speed.
    """
    brake = bench.caps.brake_m_s2
    share = blur * share_off(bench, brake, at_least=True)
    ways = {
        way: [each.end.rate_m_s2 for each in trials if each.backwards is backwards]
        for backwards, way in ((False, ""), (True, " on its way backwards"))
    }
    if not bench.caps.in_process and min(map(len, ways.values())) < _ENOUGH:
        ways = {"": [each.end.rate_m_s2 for each in trials]}
    for way, seen in ways.items():
        if seen:
            # Two of three trials may have met a busy host; weak brakes are weak every time.
            bench.measure(
                name, max(seen) if len(seen) <= _ENOUGH else median(seen), brake, share * brake,
                f"{what}{way} it ran on too far once it had begun to brake: brake_m_s2 is declared better than it is",
                at_least=True, spread=seen,
            )  # fmt: skip


def share_off(bench: Bench, rate_m_s2: float, *, at_least: bool = False) -> float:
    """Return the relative error of a measured acceleration: on a wire there are only a few readings of each ramp."""
    return (_SHARE_IN_PROCESS if bench.caps.in_process else _SHARE) + bench.blurred(rate_m_s2, at_least=at_least)


class ToAndFro:
    """Keeps a robot driving between both ends of its room."""

    def __init__(self, bench: Bench, robot: Robot) -> None:
        self._robot: Final = robot
        self._ends: Final = cycle((bench.place(robot, -_TURNS_AT), bench.place(robot, _TURNS_AT)))
        self.end = next(self._ends)
        self.goal = robot.goto(self.end, Controller.AC)

    def go_on(self, *, anew: bool = False, speed_m_s: float | None = None) -> bool:
        """Send the robot to the other end if it has arrived, or if `anew`; return False, so that driving goes on."""
        if not self.goal.active:
            self.end = next(self._ends)
        if anew or not self.goal.active:
            self.goal = self._robot.goto(self.end._replace(speed_m_s=speed_m_s), Controller.AC)
        return False


class Shuttle:
    """Drives a robot to and fro in its room, from rest to an even speed and to rest.

    A robot that reverses goes forwards and backwards in turn; any other turns round at the end of its room.

    Attributes:
        end: the end of the room straight ahead of the robot.
    """

    def __init__(self, bench: Bench, robot: Robot) -> None:
        self._bench: Final = bench
        self._robot: Final = robot
        self._reaction_s: Final = reaction_s(bench.caps)
        self._number = self._driven = 0
        self.end = bench.place(robot, _END)
        self._behind: Waypoint | None = None
        self._turn()

    def trials(
        self,
        count: int,
        stop: Callable[[Goal], object],
        *,
        waits_s: float = 0.0,
        renew: bool = True,
        cause: str = "a stop does not stop",
        speed_m_s: float | None = None,
        after: Callable[[], object] = lambda: None,
    ) -> Iterator[Trial]:
        """Yield how the robot got going after a goto, and how it came to rest after `stop`.

        Args:
            count: how many trials.
            stop: stops the robot, which drives to the goal.
            waits_s: how long the robot may wait before it begins to stop.
            renew: whether the lease is renewed while the robot comes to rest.
            cause: the likely cause if it does not.
            speed_m_s: a cap on the speed, or None.
            after: called after every trial, with the robot at rest.
        """
        bench, robot = self._bench, self._robot
        # A host that pauses for longer than the lease stops the robot too, which may void a few trials.
        good, void = 0, -max(_VOID, count // 8)
        while good < count:
            self._make_way(waits_s)
            backwards = self._behind is not None and self._driven % 2 == 1
            self._driven += 1
            self._wait_oddly()
            sent_s = bench.now_s
            target = self._behind if backwards and self._behind else self.end
            goal = self._go(target._replace(speed_m_s=speed_m_s))
            self._wait_oddly()
            called_s = bench.now_s
            stop(goal)
            self._rest(waits_s, cause, renew=renew)
            seen = bench.tracks[robot.id]
            start = fit_start([each for each in seen if each.at_s <= called_s], sent_s)
            end = fit_stop(seen, called_s)
            goal.cancel()
            if start is not None and end is not None:
                good += 1
                bench.ramps += (start, end)
                yield Trial(start, end, called_s, backwards)
            else:
                void += 1
                bench.require(void <= 0, "it did not keep an even speed on a straight leg: it stops and goes")
            after()
            bench.run(_REST_S, closely=True)
            del seen[: -len(bench.since(robot, bench.now_s - 2.0 * CRUISE_S))]

    def measure_start(self, name: str, cause: str, call: Callable[[], object] = lambda: None) -> None:
        """Judge how soon the robot gets going from rest after a call and an immediate goto."""
        bench, robot = self._bench, self._robot
        self._make_way(0.0)
        called_s = bench.now_s
        call()
        bench.get_going(robot, self.end, closely=True, cause=cause)
        bench.keep_on()
        start = fit_start(bench.tracks[robot.id], called_s)
        bench.require(start is not None, "it did not keep an even speed on a straight leg: it stops and goes")
        assert start is not None
        bench.ramps.append(start)
        bench.measure(name, start.begins_s, bench.caps.latency_s + bench.caps.jitter_s, bench.fit_s, cause)

    def _go(self, target: Waypoint) -> Goal:
        bench, robot = self._bench, self._robot
        goal = bench.get_going(robot, target, closely=True)
        bench.keep_on()
        return goal

    def _make_way(self, waits_s: float) -> None:
        """Turn round if the end is too near to get up to speed and stop; see `trials`."""
        left_m = self._bench.tracks[self._robot.id][-1].distance_m(self.end.x_m, self.end.y_m)
        if left_m < run_m(self._bench.caps, self._bench.gains_s, waits_s):
            self._turn()

    def _rest(self, waits_s: float, cause: str, *, renew: bool) -> None:
        """Wait until the robot is at rest; fail the clause if it never is."""
        bench, robot = self._bench, self._robot
        # No longer than a robot needs that is to turn and drive on at once.
        ramp_s = bench.brakes_s + min(0.5 * bench.brakes_s, _TAIL_S)
        bench.run(waits_s + self._reaction_s + ramp_s + _REST_S, renew=renew, closely=True)
        give_up_s = bench.now_s + _LONGEST_REST_S
        while bench.now_s < give_up_s:
            last, recent = bench.tracks[robot.id][-1], bench.since(robot, bench.now_s - _REST_S)
            if all(last.distance_m(each.x_m, each.y_m) <= bench.still_m for each in recent):
                return
            bench.run(_REST_S, renew=renew, closely=True)
        bench.require(False, f"it still moves {_LONGEST_REST_S:.0f} s after it had to be at rest: {cause}")

    def _turn(self) -> None:
        """Point the robot at the other end, so that the following trials are straight ahead."""
        bench, robot = self._bench, self._robot
        ahead, behind = bench.place(robot, _END), bench.place(robot, -_END)
        here = bench.look(robot)
        away = here.distance_m(ahead.x_m, ahead.y_m) > here.distance_m(behind.x_m, behind.y_m)
        self.end = ahead if away else behind
        self._go(self.end).cancel()
        self._rest(0.0, "a cancel does not stop it", renew=True)
        self._driven, self._behind = 0, self._straight_back() if bench.caps.reverses else None

    def _straight_back(self) -> Waypoint | None:
        """Return a target to reach backwards; None if the robot takes no headings, by which a goal asks for that."""
        bench, robot = self._bench, self._robot
        here = bench.look(robot)
        heading_rad = math.atan2(self.end.y_m - here.y_m, self.end.x_m - here.x_m)
        back_m = _BACK * bench.harness.room_m
        target = Waypoint(
            here.x_m - back_m * math.cos(heading_rad), here.y_m - back_m * math.sin(heading_rad),
            heading_rad=heading_rad,
        )  # fmt: skip
        with suppress(Unsupported):
            robot.goto(target, Controller.AC).cancel()
            bench.run(self._reaction_s + _REST_S)
            return target
        return None

    def _wait_oddly(self) -> None:
        """Vary the phase of the vehicle's period at which the next call comes."""
        bench = self._bench
        self._number += 1
        odd = self._number * GOLDEN % 1.0
        if bench.caps.in_process:
            # All moments of a control period are alike there, but not those of a slower cycle, such as a planner's.
            bench.run(int(odd * _ODD_TICKS) * TICK_S)
            return
        bench.fleet.clock.sleep_until(bench.now_s + odd * TICK_S)
        bench.look(self._robot)
