"""Crowd: commands and samples of one robot are neither lost nor late because of others' at the same moment."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import quantile
from soter.conformance.trials import Shuttle
from soter.sdk import Controller, Goal, Robot

_CROWD = 20
_ROUNDS_IN_PROCESS = 36
_ROUNDS = 18
_LOST = 0.1
_TRIALS = 4
_SAYS_S = 3.0
_TIMES = 3
_BUSY_S = 0.004
_UNEVEN = 1.5
_QUICK = 0.25
_MORE_UNEVEN = 0.1
_ALONE = 0.25
_KINDS = ("goto", "cancel", "switch")
_SHARED = (
    "they share a buffer that keeps the last message only, a queue that one of them fills or clears, a limit of how "
    "much is sent, or a lock that is held while one of them answers"
)


@clause("several.told")
def told(bench: Bench) -> None:
    """What one robot is told is neither lost nor late for what others are told at the same moment."""
    robots = bench.open_most()
    # First find out which kinds of command the samples show at all, with the other robots left alone.
    shown = [kind for kind in _KINDS if _shows(bench, robots[0], (), kind)]
    lost: list[str] = []
    rounds = _ROUNDS_IN_PROCESS if bench.caps.in_process else _ROUNDS
    for number in range(rounds if shown else 0):
        robot, kind = robots[number % len(robots)], shown[number // len(robots) % len(shown)]
        if not _shows(bench, robot, [each for each in robots if each is not robot], kind):
            lost.append(f"a {kind} of robot {robot.id}")
    # On a wire a single message may be lost, and the next renewal makes up for it.
    bench.measure(
        "lost", len(lost) / rounds, 0.0 if bench.caps.in_process else _LOST, 1e-9,
        f"{', '.join(lost[:3])} was lost or late while others were told much at the same moment: {_SHARED}",
    )  # fmt: skip
    for robot in (robots[0], robots[-1]):
        _obeys_as_soon(bench, robot, [each for each in robots if each is not robot])
        bench.run(TICK_S)


def _shows(bench: Bench, robot: Robot, others: Sequence[Robot], kind: str) -> bool:
    """Send one robot a command between many to others; return whether its samples show the command in time."""
    caps = bench.caps
    within_s = caps.latency_s + caps.sample_age_s + caps.jitter_s + 2 * TICK_S
    goal: Goal | None = robot.goto(bench.place(robot, 0.1), robot.in_charge) if kind != "goto" else None
    bench.run(within_s)
    if kind == "cancel" and bench.look(robot).state.goal_id is None:
        return False
    _tell_much(bench, others)
    if kind == "goto":
        goal = robot.goto(bench.place(robot, 0.2), robot.in_charge)
    elif kind == "cancel" and goal is not None:
        goal.cancel()
    else:
        robot.switch_ac_sc(_other(robot.in_charge), "conformance")
    _tell_much(bench, others)
    # No renewals meanwhile: they would make up for a lost command.
    bench.run(within_s, renew=False)
    state = bench.look(robot).state
    if kind == "switch":
        return state.controller is robot.in_charge
    named = state.goal_id == (goal and goal.id)
    return named if kind == "goto" else not named


def _tell_much(bench: Bench, robots: Sequence[Robot]) -> None:
    """Send robots many commands at once: to each several gotos, a cancel, a switch, and a goto."""
    for robot in robots:
        goals = [robot.goto(bench.place(robot, 0.1 * (number % 2)), robot.in_charge) for number in range(_CROWD)]
        goals[-1].cancel()
        robot.switch_ac_sc(_other(robot.in_charge), "conformance")
        robot.goto(bench.place(robot, 0.1), robot.in_charge)


def _other(controller: Controller) -> Controller:
    return Controller.SC if controller is Controller.AC else Controller.AC


def _obeys_as_soon(bench: Bench, robot: Robot, others: Sequence[Robot]) -> None:
    """Judge how soon a driving robot comes to rest at a cancel just before or after many commands to others."""
    caps, cancelled_s = bench.caps, [0.0]
    robot.switch_ac_sc(Controller.AC, "conformance")

    def stop(goal: Goal) -> None:
        first = len(cancelled_s) % 2 == 0
        if not first:
            _tell_much(bench, others)
        cancelled_s.append(bench.now_s)
        goal.cancel()
        if first:
            _tell_much(bench, others)

    begins_s = [
        trial.called_s + trial.end.begins_s - cancelled_s[-1]
        for trial in Shuttle(bench, robot).trials(bench.trials(_TRIALS), stop)
    ]
    bench.measure(
        "told_s", max(begins_s), caps.latency_s + caps.jitter_s, bench.fit_s,
        f"robot {robot.id} stops later where others are told much at the same moment: {_SHARED}", spread=begins_s,
    )  # fmt: skip


@clause("several.said")
def said(bench: Bench) -> None:
    """What one robot says is not lost for what others say: its samples come as evenly as those of one alone."""
    worse: list[tuple[float, int]] = []
    busy: list[tuple[float, int]] = []
    # On a wire a busy host may make samples uneven once; a fault of the robots shows again.
    while len(busy) + len(worse) < _TIMES and not (worse and (bench.caps.in_process or worse[-1][0] <= _MORE_UNEVEN)):
        if bench.fleets:
            bench.close()
        (alone,) = _uneven(bench, (bench.open_one(),)).values()
        bench.close()
        seen = _uneven(bench, bench.open_most())
        robot_id = max(seen, key=seen.__getitem__)
        # If one robot's samples alone come unevenly, too, the host is too busy to judge.
        (worse if alone <= _ALONE else busy).append((seen[robot_id] - alone, robot_id))
    by, robot_id = min(worse or busy)
    bench.measure(
        "uneven", max(by, 0.0), _MORE_UNEVEN, 1e-9,
        f"with others there so many more samples of robot {robot_id} are missing than of one robot alone: what another "
        "says takes their place in a buffer that keeps the last message only; one for each robot",
        spread=[each for each, _ in worse or busy],
    )  # fmt: skip


def _uneven(bench: Bench, robots: Sequence[Robot]) -> dict[int, float]:
    """Return, by robot, the share of samples that came at a longer interval than its quicker ones."""

    def computes() -> bool:
        # Keep the interpreter busy, as a supervisor does, while the receiving threads wait for it.
        until_s = time.monotonic() + _BUSY_S
        while time.monotonic() < until_s and not bench.caps.in_process:
            pass
        return False

    began_s = bench.now_s
    bench.run(_SAYS_S, computes, closely=True)
    shares = {}
    for robot in robots:
        gaps_s = [after.at_s - before.at_s for before, after in pairwise(bench.since(robot, began_s))]
        most_s = _UNEVEN * quantile(gaps_s, _QUICK)
        shares[robot.id] = sum(each > most_s for each in gaps_s) / len(gaps_s)
    return shares
