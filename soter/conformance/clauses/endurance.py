"""Endurance: faults that show only after a while, or seldom."""

from __future__ import annotations

import gc
import math
import sys
import time
from array import array
from collections import deque
from itertools import pairwise
from statistics import median
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.clauses.bounds import turns_at_least
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.lateness import Regularity
from soter.conformance.track import turn
from soter.conformance.trials import Shuttle, ToAndFro, measure_braking
from soter.conformance.usage import usage
from soter.sdk import Controller, Robot, Waypoint

_ROUND_S: Final = 22.0
_ROUNDS, _ROUNDS_IN_PROCESS = 3, 4
"""Enough rounds for faults that occur once a minute."""

_TURNS, _TURNS_IN_PROCESS = 16, 64
_ALTERNATE: Final = 4
_ASIDE_RAD: Final = 0.4
_AWAY_M: Final = 0.3
_REST_M: Final = 2e-4
_REST_RAD: Final = 1e-3
_OFF_RAD: Final = 0.05
_MISSION_S: Final = 600.0
_STEADY: Final = 0.3
_LOOKS_S: Final = 1.0
_SWITCHES: Final = 10
_STOPS: Final = 4

_COUNTED: Final = 2**16 + 2**13
_COUNTS_FOR_S: Final = 20.0
_AT_ONCE: Final = 400
_EVERY_S: Final = 0.02
_NAMED_S: Final = 0.5

_GROWS: Final = {
    "threads": (3.0, "a thread is begun at each goal or switch, and not ended"),
    "descriptors": (3.0, "a file or socket is opened at each goal or switch, and not closed"),
    "objects_per_goal": (0.3, "goals, samples or messages are kept; what looks through them takes ever longer"),
    "memory_mib": (0.25, "messages are kept"),
}
"""By resource, how much more of it the process may hold after each round, and the likely cause of more."""

_GROWS_S: Final = 0.01
_KEPT: Final = 20
_MANY: Final = 200


@clause("endurance.minute")
def minute(bench: Bench) -> None:
    """In more than a minute of driving no goal is taken late, brakes and places stay true, and no more is held."""
    robot = bench.open_one()
    began_s, off_rad = bench.now_s, _heading_off(bench, robot)
    commands, ages_s = _Commands(bench, robot), []
    held = [_held()]
    rounds = _ROUNDS_IN_PROCESS if bench.caps.in_process else _ROUNDS
    lasts_s = rounds * _ROUND_S
    for _ in range(rounds):
        commands.drive(_ROUND_S)
        for to in (Controller.SC, Controller.AC) * _SWITCHES:
            robot.switch_ac_sc(to, "conformance")
        held.append(_held())
        ages_s.append(median(commands.ages_s))
    bench.measure(
        "age_growth_s", ages_s[-1] - ages_s[0], _GROWS_S, bench.read_s,
        f"in {lasts_s:.0f} s samples have grown older by so much: the vehicle's clock is slow, and is not followed",
    )  # fmt: skip
    # On a wire one late goal may be due to the host; a fault of the robot's shows again.
    excused = 0 if bench.caps.in_process else 1
    if sum(each > bench.caps.latency_s + bench.fit_s for each in commands.late_s()) == excused == 1:
        commands.drive(lasts_s)
    late_s = commands.late_s()
    if len(late_s) > excused:
        bench.measure(
            "command_rare_s", sorted(late_s)[-1 - excused], bench.caps.latency_s, bench.fit_s,
            f"of {len(late_s)} goals some were taken late: now and then the robot, or the wire, does something else "
            "first", spread=late_s,
        )  # fmt: skip
    commands.shuttle.goal.cancel()
    bench.settle()
    tired = [*Shuttle(bench, robot).trials(bench.trials(_STOPS), lambda goal: goal.cancel())]
    measure_braking(bench, tired, f"after {lasts_s:.0f} s of driving", "tired_brake_m_s2")
    _turn_much(bench, robot)
    bench.settle()
    state = bench.look(robot).state
    if bench.fleet.truth is not None or bench.harness.gives("observe"):
        bench.measure(
            "position_drift_m", math.dist((state.x_m, state.y_m), bench.true_pose(robot.id)[:2]),
            bench.caps.position_noise_m, _REST_M,
            f"at rest after {lasts_s:.0f} s of driving its place is off: it counts wheels and loses count, or its "
            "scale is wrong",
        )  # fmt: skip
        noise_rad = bench.caps.heading_noise_rad
        bench.measure(
            "heading_drift_rad", abs(turn(bench.true_pose(robot.id)[2], state.heading_rad)),
            _OFF_RAD if noise_rad is None else noise_rad, _REST_RAD,
            "at rest after much turning its heading is off: it adds up turn rates, and their error with them",
        )  # fmt: skip
        if bench.harness.starts_robots and noise_rad is not None:
            grown_rad = abs(turn(off_rad, _heading_off(bench, robot)))
            bench.measure(
                "heading_growth_rad", grown_rad, noise_rad * (bench.now_s - began_s) / _MISSION_S,
                max(_REST_RAD, _STEADY * noise_rad),
                f"its heading gets off by so much in {bench.now_s - began_s:.0f} s, and goes on so: a gyro's bias that "
                "is added up, of which heading_noise_rad allows no more in ten minutes",
            )  # fmt: skip
    for name in held[0]:
        bound, cause = _GROWS[name]
        bench.measure(
            name, max(0.0, min(after[name] - before[name] for before, after in pairwise(held))), bound, 0.0,
            f"every {_ROUND_S:.0f} s the process holds more by so much: {cause}",
        )  # fmt: skip


@clause("endurance.counters")
def counters(bench: Bench) -> None:
    """After more goals than sixteen bits can number a robot obeys as before, and names the goal that it works on."""
    robot, sent, late_s = bench.open_one(), 0, 0.0
    last: list[tuple[float, int]] = []
    until_s = time.monotonic() + _COUNTS_FOR_S
    # On a host that is too slow for all goals, those that were sent count.
    while sent < _COUNTED and time.monotonic() < until_s:
        goals = [robot.goto(bench.place(robot, 0.1 * (each % 2)), Controller.AC) for each in range(_AT_ONCE)]
        sent += len(goals)
        last.append((bench.now_s, goals[-1].id))
        bench.run(_EVERY_S)
        named = bench.look(robot).state.goal_id
        if named is not None:
            late_s = max(late_s, bench.now_s - next((at_s for at_s, each in last if each > named), bench.now_s))
    bench.measure("goals_sent", sent)
    bench.settle()
    cause = f"after {sent} goals it does not obey any more: what numbers goals or messages has too few digits"
    goal = bench.get_going(robot, bench.place(robot, 0.8), cause=cause)
    named = bench.look(robot).state.goal_id
    bench.require(
        named in (None, goal.id), f"after {sent} goals samples name goal {named}, not {goal.id}: of too few digits"
    )
    goal.cancel()
    bench.expect_stop(robot, cause)
    bench.measure(
        "named_late_s", late_s, _NAMED_S, bench.read_s,
        f"among {sent} goals for so long none was taken: where a number has no more digits and begins anew, newer "
        "messages are taken for older ones",
    )  # fmt: skip


def _turn_much(bench: Bench, robot: Robot) -> None:
    """Turn a robot on the spot to the left, the right and both in turn; fail the clause if it gets slow."""
    if not bench.caps.pivots_first:
        return
    turns = _TURNS_IN_PROCESS if bench.caps.in_process else _TURNS
    for number in range(turns):
        left = turns - number
        if left == _ALTERNATE:
            bench.settle()
            del bench.tracks[robot.id][:-1]
        to_left = number < (turns - _ALTERNATE) // 2 if left > _ALTERNATE else left % 2 == 0
        at = bench.look(robot)
        course_rad = at.heading_rad + math.copysign(math.pi - _ASIDE_RAD, 1.0 if to_left else -1.0)
        target = Waypoint(at.x_m + _AWAY_M * math.cos(course_rad), at.y_m + _AWAY_M * math.sin(course_rad))
        goal = robot.goto(target, Controller.AC)

        def turned(course_rad: float = course_rad) -> bool:
            return abs(turn(bench.tracks[robot.id][-1].heading_rad, course_rad)) < _ASIDE_RAD

        bench.run(bench.way_s(), turned)
        if left <= _ALTERNATE:
            goal.cancel()
            bench.settle()
    seen, off = bench.fastest(robot)
    bench.measure(
        "tired_yaw_rate_rad_s", min(seen[1:]), turns_at_least(bench), off * bench.caps.yaw_rate_max_rad_s,
        "after much turning it turns more slowly than yaw_rate_max_rad_s: something adds up, or its motors are hot",
        at_least=True,
    )  # fmt: skip


def _heading_off(bench: Bench, robot: Robot) -> float:
    """Return by how much the heading of a robot at rest is off the truth on the average of a second, signed."""
    if bench.fleet.truth is None and not bench.harness.gives("observe"):
        return 0.0
    off_rad: list[float] = []

    def look() -> bool:
        off_rad.append(turn(bench.true_pose(robot.id)[2], bench.tracks[robot.id][-1].state.heading_rad))
        return False

    bench.run(_LOOKS_S, look)
    return sum(off_rad) / len(off_rad)


class _Commands:
    """Sends a goal at every tick, and records when samples name it.

    Attributes:
        shuttle: drives the robot.
        took_s: from each goto to the stamp of the first sample that names its goal or a later one.
        ages_s: how old the last samples were when they were read.
    """

    def __init__(self, bench: Bench, robot: Robot) -> None:
        self.shuttle: Final = ToAndFro(bench, robot)
        # Arrays, because the clause counts objects.
        self.took_s: Final = array("d")
        self._bench: Final = bench
        self._robot: Final = robot
        self._sent: Final[deque[tuple[int, float]]] = deque()
        state = robot.read_state()
        self._stamp_s = state.stamp_s
        self._regular: Final = Regularity(bench, state.stamp_s)
        self._said_s = bench.now_s
        self.ages_s: Final[deque[float]] = deque(maxlen=_MANY)

    def drive(self, seconds: float) -> None:
        """Go on for some seconds."""
        self._regular.begin()
        self._sent.clear()
        self._bench.run(seconds, self._look, closely=True)

    def late_s(self) -> list[float]:
        """Return by how much each goal was late at least."""
        return self._regular.late_s(self.took_s)

    def _look(self) -> bool:
        bench, now_s = self._bench, self._bench.now_s
        track = bench.tracks[self._robot.id]
        del track[:-_KEPT]
        state = track[-1].state
        if self._regular.broken(state.stamp_s):
            self._sent.clear()
        self.ages_s.append(now_s - state.stamp_s)
        if state.stamp_s > self._stamp_s:
            self._stamp_s, named = state.stamp_s, state.goal_id
            while named is not None and self._sent and self._sent[0][0] <= named:
                self.took_s.append(state.stamp_s - self._sent.popleft()[1])
        if now_s - self._said_s >= TICK_S - ROUNDING:
            self._said_s = now_s
            self.shuttle.go_on(anew=True)
            self._sent.append((self.shuttle.goal.id, now_s))
        return False


def _held() -> dict[str, float]:
    """Return how much of each resource in `_GROWS` the process holds."""
    gc.collect()
    used = usage()
    held = {}
    if used is not None:
        held = {"threads": len(used.threads), "descriptors": len(used.descriptors), "memory_mib": used.memory_mib}
    return held | {"objects_per_goal": sys.getallocatedblocks() * TICK_S / _ROUND_S}
