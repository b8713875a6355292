"""Anything: whatever commands robots get, in whatever order, each obeys its latest one.

Other clauses each try one thing. Here commands of all kinds follow at random, and show what each leaves behind.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from soter.conformance.bench import SETTLE_S, Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.track import TrackSample, turn
from soter.errors import Unsupported
from soter.sdk import Controller, Goal, GoalStatus, Robot, Waypoint

_LASTS_S: Final = 45.0
_LASTS_IN_PROCESS_S: Final = 120.0
_SEEDS: Final = (7, 3, 37)
"""Of each robot's commands: the same ones whatever its id."""

_SILENT_EVERY_S: Final = 9.0
_SILENT_S: Final = 0.5
_TIMEOUT_S: Final = 1.0
_WAITS_S: Final = ((TICK_S, TICK_S), (TICK_S, 0.6), (0.6, 4.0), (math.inf, math.inf))
"""Ranges of the time until the next command; infinite: not before the goal has ended and the robot stands."""

_HOW_OFTEN: Final = (25, 25, 35, 15)
_REACH: Final = 0.8
_CAPPED: Final = 0.3
_LEAST_CAP: Final = 0.3
_SHOWN: Final = 6
"""How many of the last commands a failure lists."""

_TURN_ENDS_S: Final = 0.5
_FASTER: Final = 1.05
_GETS_ALONG_S: Final = 1.0
_GETS_ALONG: Final = 0.6
_HERE: Final = 0.15
"""Distance to its target, as a share of the room, at which a robot may already slow down."""


@clause("endurance.anything")
def anything(bench: Bench) -> None:
    """Whatever robots are told, in whatever order, each does what it was told last."""
    robots = bench.open(min(bench.harness.robots_most, len(_SEEDS)))
    told = [_Told(bench, robot, seed) for robot, seed in zip(robots, _SEEDS, strict=False)]
    silent_s, lasts_s = bench.now_s, _LASTS_IN_PROCESS_S if bench.caps.in_process else _LASTS_S
    until_s = bench.now_s + lasts_s
    while bench.now_s < until_s:
        bench.run(TICK_S)
        for each in told:
            each.judge()
            each.go_on()
        if bench.now_s - silent_s > _SILENT_EVERY_S:
            _be_silent(bench, told)
            silent_s = bench.now_s
    bench.measure("commands_sent", sum(each.sent for each in told))


def _be_silent(bench: Bench, told: Sequence[_Told]) -> None:
    """Fail the clause unless all robots stand while their leases are not renewed."""
    bench.run(bench.orphaned_s() + bench.caps.sample_age_s + _TURN_ENDS_S, renew=False)
    for each in told:
        each.note("silence")
        each.judge_rest()
    bench.run(_SILENT_S, renew=False)
    for each in told:
        each.judge_rest()
        # Once its lease is renewed, each robot resumes its latest command.
        each.note("renewals")


class _Told:
    """Sends a robot random commands, and judges whether it obeys the latest one.

    Attributes:
        sent: how many commands were sent.
    """

    def __init__(self, bench: Bench, robot: Robot, seed: int) -> None:
        self.sent = 0
        self._bench: Final = bench
        self._robot: Final = robot
        self._random: Final = random.Random(seed)
        self._said: Final[deque[str]] = deque(maxlen=_SHOWN)
        self._goal: Goal | None = None
        self._old: Goal | None = None
        self._target = Waypoint(robot.spec.x_m, robot.spec.y_m)
        self._dropped = True
        self._told_s = self._next_s = bench.now_s
        self._awaited = False
        self._rest: TrackSample | None = None
        self._from: TrackSample | None = None
        caps = robot.capabilities
        self._reacts_s: Final = caps.latency_s + caps.jitter_s + caps.setpoint_period_s + 2.0 * TICK_S
        self._turns_s: Final = self._reacts_s + 1.2 * math.pi / caps.yaw_rate_max_rad_s + _TURN_ENDS_S
        self._stops_s: Final = self._reacts_s + bench.brakes_s + _TURN_ENDS_S

    def go_on(self) -> None:
        """Send the next command if it is due."""
        bench = self._bench
        if self._awaited:
            if self._wanted:
                self._require(
                    bench.now_s - self._told_s <= bench.way_s(), f"does not arrive, {self._left_m():.2f} m are left"
                )
                return
            if bench.now_s < self._over_s + self._settles_s + self._stops_s:
                return
        elif bench.now_s < self._next_s:
            return
        command = self._random.choice(_COMMANDS)
        self.note(command.__name__.strip("_").replace("_", " "))
        command(self)
        self.sent += 1
        (low_s, high_s), *_ = self._random.choices(_WAITS_S, _HOW_OFTEN)
        self._awaited = math.isinf(low_s)
        self._next_s = bench.now_s + (0.0 if self._awaited else self._random.uniform(low_s, high_s))

    def note(self, what: str) -> None:
        """Note the command, or the lack of renewals, that begins now."""
        self._said.append(what)
        self._told_s, self._rest, self._from = self._bench.now_s, None, None

    def judge(self) -> None:
        """Fail the clause unless the robot obeys its latest command."""
        bench, robot, goal = self._bench, self._robot, self._goal
        sample = bench.tracks[robot.id][-1]
        since_s = sample.at_s - self._told_s
        if since_s > self._reacts_s:
            named, driver = sample.state.goal_id, sample.state.controller
            self._require(driver in (None, robot.in_charge), f"says that {driver} is in charge")
            if goal is not None and self._dropped:
                self._require(not goal.active, f"has a goal {goal.id} that is ACTIVE although it was cancelled")
            if goal is None or self._dropped:
                self._require(named is None, f"says that it works on goal {named}, which was cancelled or pre-empted")
            if goal is not None and self._wanted:
                self._require(named in (None, goal.id), f"says that it works on goal {named}, not on {goal.id}")
        if self._wanted:
            self._rest = None
            self._judge_speed(sample, since_s)
            self._judge_way(sample, since_s)
            return
        reached = goal is not None and goal.status is GoalStatus.REACHED
        if sample.at_s < self._over_s + max(self._stops_s, self._settles_s if reached else 0.0):
            return
        self.judge_rest()
        if reached:
            most_m = self._target.radius_m + bench.noise_m + bench.still_m
            self._require(self._left_m() <= most_m, f"has REACHED a goal that is {self._left_m():.2f} m away")

    def judge_rest(self) -> None:
        """Fail the clause unless the robot stands where it stood when its rest was first judged."""
        bench, sample = self._bench, self._bench.tracks[self._robot.id][-1]
        rest = self._rest = self._rest or sample
        moved_m = sample.distance_m(rest.x_m, rest.y_m)
        turned_rad = abs(turn(rest.heading_rad, sample.heading_rad))
        self._require(
            moved_m <= bench.still_m and turned_rad <= bench.still_rad,
            f"is to stand and still moves, by {moved_m:.3f} m and {turned_rad:.2f} rad",
        )

    def _judge_speed(self, sample: TrackSample, since_s: float) -> None:
        bench, cap_m_s = self._bench, self._target.speed_m_s
        if cap_m_s is None or since_s <= bench.orphaned_s() + self._reacts_s:
            return
        most_m_s = _FASTER * cap_m_s + bench.speed_noise_m_s
        self._require(sample.speed_m_s <= most_m_s, f"drives {sample.speed_m_s:.3f} m/s where {cap_m_s:.3f} is the cap")

    def _judge_way(self, sample: TrackSample, since_s: float) -> None:
        """Fail the clause unless the robot gets nearer to its target, once it has had time to turn there."""
        bench, caps, target = self._bench, self._robot.capabilities, self._target
        if not caps.pivots_first or target.heading_rad is not None or since_s < self._turns_s + bench.gains_s:
            return
        began = self._from = self._from or sample
        lasts_s, left_m = sample.at_s - began.at_s, self._left_m()
        if lasts_s < _GETS_ALONG_S or left_m < _HERE * bench.harness.room_m:
            return
        nearer_m = began.distance_m(target.x_m, target.y_m) - left_m
        least_m = _GETS_ALONG * min(target.speed_m_s or math.inf, caps.v_max_m_s) * lasts_s
        self._require(
            nearer_m + 2.0 * bench.noise_m >= least_m,
            f"gets nearer to its goal, {left_m:.2f} m away, by {nearer_m:.3f} m in {lasts_s:.2f} s",
        )

    @property
    def _wanted(self) -> bool:
        """Whether the robot has a goal to work on."""
        return self._goal is not None and self._goal.active and not self._dropped

    @property
    def _settles_s(self) -> float:
        """How long the robot may turn and drive on to its target, and turn to its heading, once within the radius."""
        target = self._target
        drives_s = target.radius_m / (target.speed_m_s or self._robot.capabilities.v_max_m_s)
        turns_s = max(SETTLE_S, self._turns_s + self._bench.gains_s + self._bench.brakes_s)
        return turns_s + drives_s + (0.0 if target.heading_rad is None else self._turns_s)

    @property
    def _over_s(self) -> float:
        """The fleet time since which the robot has had nothing to do."""
        return max(self._told_s, (self._goal and self._goal.ended_s) or 0.0)

    def _left_m(self) -> float:
        return self._bench.tracks[self._robot.id][-1].distance_m(self._target.x_m, self._target.y_m)

    def _require(self, holds: bool, what: str) -> None:
        if not holds:
            since_s = self._bench.now_s - self._told_s
            self._bench.require(
                False,
                f"robot {self._robot.id} {what}, {since_s:.2f} s after the last of these commands: "
                f"{', '.join(self._said)}; one of them is lost, late, taken for another, or done though it is over",
            )

    # --- the commands --------------------------------------------------------------------------------------

    def _place(self) -> Waypoint:
        """Return a random target in the robot's room, sometimes with a speed cap."""
        bench, chance, caps = self._bench, self._random.random, self._robot.capabilities
        far, course_rad = _REACH * math.sqrt(chance()), math.tau * chance()
        place = bench.place(self._robot, far * math.cos(course_rad), far * math.sin(course_rad))
        if chance() < _CAPPED:
            place = place._replace(speed_m_s=caps.v_max_m_s * self._random.uniform(_LEAST_CAP, 1.0))
        return place

    def _send(self, target: Waypoint) -> None:
        self._old, self._goal = self._goal, self._robot.goto(target, self._robot.in_charge)
        self._target, self._dropped = target, False

    def _goto(self) -> None:
        self._send(self._place())

    def _goto_with_heading(self) -> None:
        with suppress(Unsupported):
            self._send(self._place()._replace(heading_rad=self._random.uniform(-math.pi, math.pi)))

    def _goto_for_a_second(self) -> None:
        self._send(self._place()._replace(timeout_s=_TIMEOUT_S))

    def _same_goto_again(self) -> None:
        self._send(self._target)

    def _two_gotos_at_once(self) -> None:
        slow, quick = self._place(), self._place()
        self._send(slow._replace(speed_m_s=_LEAST_CAP * self._robot.capabilities.v_max_m_s))
        self._send(quick._replace(speed_m_s=None))

    def _goto_and_cancel(self) -> None:
        self._send(self._place())
        self._cancel()

    def _cancel(self) -> None:
        if self._goal is not None:
            self._goal.cancel()
            self._dropped = True

    def _cancel_and_goto(self) -> None:
        self._cancel()
        self._send(self._place())

    def _cancel_of_the_goal_before(self) -> None:
        if self._old is not None:
            self._old.cancel()

    def _switch(self) -> None:
        robot = self._robot
        robot.switch_ac_sc(_other(robot), "conformance")
        self._goal = None

    def _switch_and_goto(self) -> None:
        self._switch()
        self._send(self._place())

    def _switch_and_back(self) -> None:
        self._switch()
        self._switch()

    def _same_controller_again(self) -> None:
        self._robot.switch_ac_sc(self._robot.in_charge, "conformance")

    def _hand_over_again(self) -> None:
        self._robot.hand_over_again()

    def _goto_of_the_other_controller(self) -> None:
        self._robot.goto(self._place(), _other(self._robot))


def _other(robot: Robot) -> Controller:
    return Controller.SC if robot.in_charge is Controller.AC else Controller.AC


_COMMANDS: Final[tuple[Callable[[_Told], None], ...]] = (
    _Told._goto,
    _Told._goto,
    _Told._goto_with_heading,
    _Told._goto_for_a_second,
    _Told._same_goto_again,
    _Told._two_gotos_at_once,
    _Told._goto_and_cancel,
    _Told._cancel,
    _Told._cancel_and_goto,
    _Told._cancel_of_the_goal_before,
    _Told._switch,
    _Told._switch_and_goto,
    _Told._switch_and_back,
    _Told._same_controller_again,
    _Told._hand_over_again,
    _Told._goto_of_the_other_controller,
)
