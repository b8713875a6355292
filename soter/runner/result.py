"""The result of a run, as `soter run --json` writes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, model_validator

from soter.config.tables import SURVEILLANCE
from soter.record.recorder import RecordingReport
from soter.record.tracks import RunTracks

THESIS_DISENGAGEMENTS = 313
"""The thesis's disengagements in 2 h with 2 robots, mean of 4 runs: UCB/EECS-2020-99, section 3.3."""

THESIS_AC_SHARE = 0.802


class TickTimes(BaseModel, frozen=True):
    """How long something took at the ticks of a run, or how late ticks were: median, 99th percentile and maximum."""

    p50: float
    p99: float
    max: float


class TargetCounts(BaseModel, frozen=True):
    """How targets ended."""

    reached: int = 0
    unsafe: int = 0
    blocked: int = 0
    timed_out: int = 0


class ModuleFigures(BaseModel, frozen=True):
    """Figures of one module's spec monitors, over all robots. Not ground truth.

    Attributes:
        looks: margins judged.
        to_sc: changes of its decision modules from AC to SC.
        to_ac: changes back to AC.
        sc_s: robot time that they spent in SC.
        least_margin: the least margin seen, in the module's unit; None without any.
        broken: looks at which the margin was negative.
        surprises: looks at which the margin had fallen by more than the model allows.
    """

    looks: int
    to_sc: int
    to_ac: int
    sc_s: float
    least_margin: float | None
    broken: int
    surprises: int


class WorstFigures(BaseModel, frozen=True):
    """The look at which an assumption failed by the most, see `soter.rta.assumptions.Worst`."""

    excess: float
    unit: str
    time_s: float
    cause: str


class BreachFigures(BaseModel, frozen=True):
    """How often, and how badly, one assumption of the safety argument failed for one robot.

    Attributes:
        times: number of looks at which it failed.
        first_s: fleet time of the first of them.
        cause: what was seen at the first.
        last_s: fleet time of the last of them; None in results of older versions.
        worst: the worst look for each unit of an excess; empty if none was measured.
    """

    times: int
    first_s: float
    cause: str
    last_s: float | None = None
    worst: tuple[WorstFigures, ...] = ()


class StallFigures(BaseModel, frozen=True):
    """A stall that lasted to the end of the run: a robot without its AC for long, and not charging.

    Attributes:
        since_s: fleet time at which it began.
        lasted_s: its length up to the end.
        module: the module whose safe controller had the robot at the end.
        cause: why that module had it, in words.
    """

    since_s: float
    lasted_s: float
    module: str
    cause: str = ""


class UncontrolledFigures(BaseModel, frozen=True):
    """A robot that for a time did not obey its supervisor.

    Attributes:
        first_s: fleet time of the first tick at which it did not obey.
        lasted_s: how long it did not obey, in total.
        cause: what it did instead at first.
    """

    first_s: float
    lasted_s: float
    cause: str


class FaultFigures(BaseModel, frozen=True):
    """One injected fault of one robot.

    Attributes:
        kind: its kind.
        robot: the robot's id.
        declared: whether the robot's promises were widened for it; if not, the stack did not know of it.
        affected: number of commands and samples that it altered, or of times that it impaired the vehicle.
    """

    kind: str
    robot: int
    declared: bool
    affected: int


class RunResult(BaseModel, frozen=True):
    """The result of a run.

    Attributes:
        status: `completed`, `interrupted` or `failed`.
        failure: why it failed; empty otherwise.
        violations: number by rule, judged by ground truth; None without truth.
        contacts: times that bodies began to touch; None without truth.
        truth_ended_s: fleet time at which ground truth fell silent: violations, contacts and margins are those up to
            then, and what happened later is not known; None if it lasted to the end, or without truth.
        ac_share: part of the robots' time in which their AC was in control.
        ac_share_without_charging: `ac_share`, not counting the time in which the battery module was in SC.
        disengagements: AC -> SC switches, by the module that fired first.
        joined: further modules that fired in the same tick.
        disengagements_total: the sum of `disengagements`.
        needless: disengagements after which the AC's pending waypoints, rolled forward, would have kept the rule.
        targets: how targets ended.
        targets_reached: equal to `targets.reached`.
        longest_stall_s: longest time that a robot, short of its target and not charging, stayed within 0.1 m.
        longest_without_ac_s: longest time that a robot was without its AC, and not charging.
        permanent_stalls: by robot, times without AC, and not charging, of at least 300 s that lasted to the end of the
            run; not for robots whose AC has failed for good.
        never_moved: robots that in more than a minute never got farther than 0.05 m from where they began.
        no_progress_s: longest time in which no robot's target ended.
        min_margin: least margin by rule, from truth, in metres or parts of a charge; NaN for a user's rule whose margin
            was not a number at some time, which counts as a violation. JSON has null for NaN, and for infinity.
        paths_replaced: plans in whose place the protected planner's certified path was used.
        no_certified_motion: ticks at which neither a motion nor holding kept every rule.
        duration_s: simulated or vehicle time.
        wall_s: host time.
        real_time_factor: `duration_s` divided by `wall_s`.
        monitors: by module, the figures of its spec monitors.
        dm_tick_us: host time that one robot's decision modules took at one tick, in microseconds.
        tick_late_ms: how late ticks came on a wall clock, in milliseconds; None in virtual time.
        peer_age_ms: how old samples of other processes' robots were at the ticks, at most, in milliseconds; None
            without such robots.
        peer_tick_us: host time that the exchange with other processes took at a tick, in microseconds, or None.
        real_time: whether ticks were scheduled in real time, before other work of the host.
        sandbox: what the kernel denied the mission's process, by which means, or what it did not, and why; empty
            with `isolation.sandbox = "off"`; None in virtual time, where the mission has no own process.
        answered: share of the ticks that the mission's process has answered, which is small if the mission or a
            controller is slow; None in virtual time, where all are answered.
        missed_ticks: ticks that came later than the robots' declared jitter.
        deterministic: whether the same seed gives the same run; False if host time had an influence.
        trace_sha256: hash over all states and decisions.
        faults: the faults injected by the mission's `[[fault]]` tables.
        assumptions: by robot, and by number (see `soter.rta.Assumption`), the assumptions that failed.
        uncontrolled: by robot, times at which a robot did not obey, such as one that a pilot took over.
        accepted_unproved: conditions that are not proved, but were accepted by `--accept-unproved`.
        ac: what the ACs were.
        does: the mission, as the file names it.
        targets_from: the set that the surveillance mission's targets are drawn from; empty for other missions.
        process: the process of a distributed mission with this result, whose figures are those of its own robots;
            empty for a mission in one process.
    """

    status: str
    failure: str
    mission: str
    backend: str
    engine: str | None = None
    planner: str
    does: str = SURVEILLANCE
    targets_from: str
    modules: tuple[str, ...]
    robots: int
    seed: int
    duration_s: float
    wall_s: float
    real_time_factor: float
    violations: dict[str, int] | None = None
    contacts: int | None = None
    ac_share: float = 0.0
    ac_share_without_charging: float = 0.0
    disengagements: dict[str, int]
    joined: dict[str, int]
    disengagements_total: int = 0
    needless: int = 0
    targets: TargetCounts
    targets_reached: int
    longest_stall_s: float = 0.0
    no_progress_s: float
    min_margin: dict[str, float] | None = None
    paths_replaced: int = 0
    no_certified_motion: int = 0
    monitors: dict[str, ModuleFigures] = {}
    dm_tick_us: TickTimes
    answered: float | None = None
    missed_ticks: int = 0
    tick_late_ms: TickTimes | None = None
    real_time: bool = False
    sandbox: dict[str, str] | None = None
    truth_ended_s: float | None = None
    deterministic: bool
    nondeterminism: str
    trace_sha256: str = ""
    failed_robots: dict[int, str] = {}
    faults: tuple[FaultFigures, ...] = ()
    assumptions: dict[int, dict[str, BreachFigures]] = {}
    longest_without_ac_s: float = 0.0
    permanent_stalls: dict[int, StallFigures] = {}
    never_moved: tuple[int, ...] = ()
    uncontrolled: dict[int, UncontrolledFigures] = {}
    accepted_unproved: tuple[str, ...] = ()
    ac: str = "mission"
    process: str = ""
    peer_age_ms: TickTimes | None = None
    peer_tick_us: TickTimes | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_margins(cls, given: Any) -> Any:
        """Take a margin that JSON has as null: infinity, or NaN if the rule was broken."""
        margins = given.get("min_margin") if isinstance(given, dict) else None
        if not isinstance(margins, dict) or None not in margins.values():
            return given
        counted = given.get("violations")
        broken = {rule for rule, count in counted.items() if count} if isinstance(counted, dict) else ()
        absent = {rule: math.nan if rule in broken else math.inf for rule in margins if margins[rule] is None}
        return {**given, "min_margin": {**margins, **absent}}

    @property
    def violated(self) -> bool:
        """Whether ground truth counted a violation."""
        return self.violations is not None and any(self.violations.values())

    @property
    def abandoned(self) -> list[str]:
        """Why each robot lost its AC for good, a text each; empty unless all did, and so none does the mission."""
        return self._given_up if self.robots and len(self.failed_robots) == self.robots else []

    @property
    def _given_up(self) -> list[str]:
        return [f"robot {robot} lost its AC: {why}" for robot, why in self.failed_robots.items()]

    @property
    def troubles(self) -> list[str]:
        """What went wrong without breaking a rule, a text each; `soter run --strict` fails if there is any."""
        failed = [
            f"assumption {number} failed for robot {robot} "
            f"({'once' if breach.times == 1 else f'{breach.times} times'}, first after {breach.first_s:g} s)"
            for robot, breaches in self.assumptions.items()
            for number, breach in breaches.items()
        ]
        stalled = [
            f"robot {robot} stalled for good after {stall.since_s:g} s, with the safe controller of '{stall.module}'"
            for robot, stall in self.permanent_stalls.items()
        ]
        lost = [
            f"robot {robot} was not under control for {each.lasted_s:g} s, first after {each.first_s:g} s: {each.cause}"
            for robot, each in self.uncontrolled.items()
        ]
        never = [f"robot {robot} never moved" for robot in self.never_moved]
        return [*lost, *failed, *stalled, *self._given_up, *never]


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        result: the result.
        tracks: where the robots were, and which controller was active.
        recording: the outcome of its recording; None if there is none.
        falls: how the least margin of `Follower.falls_of` fell: fleet time of each tick at which it was less than
            before, and its value then, by ground truth.
    """

    result: RunResult
    tracks: RunTracks
    recording: RecordingReport | None = None
    falls: tuple[tuple[float, float], ...] = ()
