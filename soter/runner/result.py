"""The result of a run, as `soter run --json` writes it."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel

from soter.config.tables import SURVEILLANCE
from soter.record.recorder import RecordingReport
from soter.record.tracks import RunTracks

THESIS_DISENGAGEMENTS = 313
"""In 2 h with 2 robots, mean of 4 runs: UCB/EECS-2020-99, section 3.3."""

THESIS_AC_SHARE = 0.802


class TickTimes(BaseModel, frozen=True):
    """How long something took at the ticks of a run, or how late it came: median, 99th percentile, and the worst."""

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
    """What the spec monitors of one module saw, all robots together. Not ground truth.

    Attributes:
        looks: margins judged.
        to_sc: changes of its decision modules from AC to SC.
        to_ac: changes back.
        sc_s: robot time that it spent in SC.
        least_margin: the least margin seen, in the module's unit; None if there was none.
        broken: looks at which the margin was negative.
        surprises: looks at which it had fallen by more than the model allows.
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
    """How often one assumption of the safety argument was seen not to hold for one robot.

    Attributes:
        times: looks at which it did not.
        first_s: fleet time of the first.
        cause: what was seen then.
        last_s: fleet time of the last; None in results of older versions.
        worst: the worst look for each unit of an excess; empty where none could be measured.
    """

    times: int
    first_s: float
    cause: str
    last_s: float | None = None
    worst: tuple[WorstFigures, ...] = ()


class StallFigures(BaseModel, frozen=True):
    """A robot that was without its AC, and not charging, from some time until the end of the run, for long.

    Attributes:
        since_s: fleet time from which on.
        lasted_s: until the end.
        module: whose safe controller had it at the end.
        cause: why, in words.
    """

    since_s: float
    lasted_s: float
    module: str
    cause: str = ""


class UncontrolledFigures(BaseModel, frozen=True):
    """A robot that for a time did not do what it was told.

    Attributes:
        first_s: fleet time of the first tick at which it did not.
        lasted_s: how long it did not, all times together.
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
        declared: whether the robot's promises were widened by it; if not, the stack was not told.
        affected: commands and samples that it spoilt, or times that it impaired the vehicle.
    """

    kind: str
    robot: int
    declared: bool
    affected: int


class RunResult(BaseModel, frozen=True):
    """What happened in a run.

    Attributes:
        status: `completed`, `interrupted` or `failed`.
        failure: why it failed; empty otherwise.
        violations: by rule, judged by ground truth; None where there is no truth.
        contacts: times that bodies began to touch; None without truth.
        truth_ended_s: fleet time at which ground truth fell silent: violations, contacts and margins are those up to
            then, and what happened later is not known; None if it was heard to the end, or if there is none.
        ac_share: part of the robots' time in which their AC was in control.
        ac_share_without_charging: the same, leaving out the time in which the battery module was in SC.
        disengagements: AC -> SC switches by the module that fired first.
        joined: further modules that fired in the same tick.
        disengagements_total: their sum.
        needless: after how many of them the AC's pending waypoints, rolled forward, would have kept the rule.
        targets: how targets ended.
        targets_reached: the same as `targets.reached`.
        longest_stall_s: longest time that a robot with a target, and not charging, stayed within 0.1 m.
        longest_without_ac_s: longest time that a robot was without its AC, and not charging.
        permanent_stalls: by robot, those that were so from some time until the end of the run, for at least 300 s; but
            for robots whose AC has failed for good.
        never_moved: robots that in more than a minute never got farther than 0.05 m from where they began.
        no_progress_s: longest time in which no robot's target ended.
        min_margin: least margin by rule, from truth, in metres or parts of a charge.
        paths_replaced: plans for which the protected planner's certified way was used instead.
        no_certified_motion: ticks at which neither a motion nor holding kept every rule.
        duration_s: simulated or vehicle time.
        wall_s: host time.
        real_time_factor: the one divided by the other.
        monitors: by module, what its spec monitors saw.
        dm_tick_us: host time that one robot's decision modules took at one tick, in microseconds.
        tick_late_ms: how late ticks came on a wall clock, in milliseconds; None in virtual time.
        peer_age_ms: how old samples of other processes' robots were at the ticks, at most, in milliseconds; None where
            there are none.
        peer_tick_us: host time that hearing and telling other processes took at a tick, in microseconds, likewise.
        real_time: whether ticks were scheduled in real time, before everything else that the host had to do.
        sandbox: what the kernel has taken from the mission's process, and by what, or that it has not, and why; empty
            with `isolation.sandbox = "off"`; None in virtual time, where the mission has no process of its own.
        missed_ticks: ticks that came later than the robots' declared jitter.
        deterministic: the same seed gives the same run; False where host time had a say.
        trace_sha256: over all states and decisions.
        faults: what was injected, by the mission's `[[fault]]` tables.
        assumptions: by robot, and by number (see `soter.rta.Assumption`), those that were seen not to hold.
        uncontrolled: by robot, those that for a time were under nobody's control, such as those that a pilot took.
        accepted_unproved: what was run although it is not proved, by `--accept-unproved`; empty if nothing was.
        ac: who the ACs were.
        does: the mission, as the file names it.
        targets_from: the set that the surveillance mission's targets are drawn from; empty for other missions.
        process: which process of a distributed mission this was, whose figures are those of its own robots; empty for
            a mission in one process.
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

    @property
    def violated(self) -> bool:
        """Whether ground truth counted a violation."""
        return self.violations is not None and any(self.violations.values())

    @property
    def abandoned(self) -> list[str]:
        """Why each robot lost its AC for good, a text each; empty unless all did, so that nobody did the mission."""
        return self._given_up if self.robots and len(self.failed_robots) == self.robots else []

    @property
    def _given_up(self) -> list[str]:
        return [f"robot {robot} lost its AC: {why}" for robot, why in self.failed_robots.items()]

    @property
    def troubles(self) -> list[str]:
        """What went wrong without breaking a rule, a text each; `soter run --strict` wants none."""
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
    """What a run leaves behind.

    Attributes:
        result: the figures.
        tracks: where the robots were, and who was in control.
        recording: how its recording went; None if there is none.
        falls: how the least margin of one rule fell, where that was asked for: fleet time of each tick at which it had
            fallen, and what it was then, by ground truth and as the result has it.
    """

    result: RunResult
    tracks: RunTracks
    recording: RecordingReport | None = None
    falls: tuple[tuple[float, float], ...] = ()
