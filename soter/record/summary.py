"""Summarises a recording in figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from msgspec import UNSET

from soter.record import messages
from soter.record.attachments import Result
from soter.record.content import Content
from soter.record.looks import Stall
from soter.record.reader import Recording
from soter.rta import Breach, Worst


@dataclass(frozen=True, slots=True)
class AssumptionFailure:
    """An assumption of the safety argument that failed for one robot.

    Attributes:
        assumption: its number.
        times: number of looks at which it failed.
        first_s: fleet time of the first.
        last_s: fleet time of the last; None if the recording does not say.
        cause: the observation at the first.
        worst: the worst look for each unit of an excess: excess, unit, fleet time and cause.
    """

    robot_id: int
    assumption: str
    times: int
    first_s: float
    last_s: float | None
    cause: str
    worst: tuple[Worst, ...] = ()


@dataclass(frozen=True, slots=True)
class Summary:
    """A recording in figures.

    Attributes:
        truncated: whether it was not closed; everything up to its last whole chunk is there.
        started_utc: when the run started, in ISO 8601.
        virtual_time: whether time stood still while nobody slept.
        duration_s: fleet time from the first recorded tick to the end of the last one.
        dropped_ticks: number of missing ticks, because the writer did not keep up.
        ac_share: part of the robots' time in which their AC was active.
        disengagements: number by the module that fired first.
        switches: number of switches of any kind.
        goals: number of goals sent, by controller.
        targets: number of ended targets, by outcome.
        faults: number of commands and samples spoilt by injected faults, by kind.
        violations: number by rule, by ground truth.
        unknown: why the violations are not fully known; empty if ground truth judged the run to its end.
        stalls: robots that were without their AC for long, and not charging.
        never_moved: robots that never moved, by the result.
        accepted_unproved: what the user accepted without proof.
        status: how the run ended; None if the recording does not say.
        versions: the versions of SOTER and its dependencies.
        digest: the result of checking the digest, in words.
    """

    file: str
    size_bytes: int
    truncated: bool
    mission: str
    backend: str
    seed: int
    started_utc: str
    virtual_time: bool
    duration_s: float
    ticks: int
    dropped_ticks: int
    robots: tuple[int, ...]
    modules: tuple[str, ...]
    ac_share: float
    disengagements: dict[str, int]
    switches: int
    goals: dict[str, int]
    targets: dict[str, int]
    transitions: int
    faults: dict[str, int]
    violations: dict[str, int]
    unknown: str
    assumptions: tuple[AssumptionFailure, ...]
    stalls: tuple[Stall, ...]
    never_moved: tuple[int, ...]
    accepted_unproved: tuple[str, ...]
    status: str | None
    versions: dict[str, str]
    digest: str


def summarise(recording: Recording, content: Content) -> Summary:
    """Return the figures of a recording."""
    about, result = recording.about, recording.result
    return Summary(
        file=str(recording.path),
        size_bytes=recording.path.stat().st_size,
        truncated=recording.truncated,
        mission=about.source,
        backend=about.backend,
        seed=about.seed,
        started_utc=about.started_utc,
        virtual_time=about.virtual_time,
        duration_s=round(content.last_s - content.first_s + about.base_tick_s, 6) if content.ticks else 0.0,
        ticks=content.ticks,
        dropped_ticks=content.dropped_ticks,
        robots=tuple(content.series),
        modules=about.modules,
        ac_share=round(content.ac_ticks / content.robot_ticks, 4) if content.robot_ticks else 0.0,
        disengagements=_counted(each.module for each in content.disengagements),
        switches=len(content.switches),
        goals=_counted(each.by for each in content.goals if each.status == "active"),
        targets=_counted(each.outcome for each in content.targets if each.outcome),
        transitions=len(content.transitions),
        faults={f"{each.kind} of robot {each.robot_id}": each.affected for each in content.faults},
        violations=_violations(content.violations, result),
        unknown=_unknown(result),
        assumptions=tuple(_in_all(content.breaches.values()) or ([] if result is None else _in_result(result))),
        stalls=tuple(
            Stall(each.robot_id, each.start_s, None if each.end_s is UNSET else each.end_s, each.module, each.cause)
            for each in content.stalls.values()
        ),
        never_moved=() if result is None else result.never_moved,
        accepted_unproved=about.accepted_unproved,
        status=None if result is None else result.status,
        versions=about.versions,
        digest="" if recording.proof is None else recording.proof.why,
    )


def _counted(names: Any) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _in_all(spells: Iterable[messages.BreachEvent]) -> list[AssumptionFailure]:
    """Return the spells of each robot and assumption as one failure."""
    joined: dict[tuple[int, str], Breach] = {}
    for each in spells:
        key = (each.robot_id, each.assumption)
        worst = tuple(Worst(one.excess, one.unit, one.time_s, one.cause) for one in each.worst)
        spell = Breach(each.times, each.start_s, each.cause, each.last_s, worst)
        joined[key] = joined[key].joined(spell) if key in joined else spell
    return [
        AssumptionFailure(robot, assumption, each.times, each.first_s, each.last_s, each.cause, each.worst)
        for (robot, assumption), each in joined.items()
    ]


def _in_result(result: Result) -> list[AssumptionFailure]:
    """Return the failures in a result, for recordings without spells."""
    return [
        AssumptionFailure(robot, assumption, each.times, each.first_s, None, each.cause)
        for robot, failed in result.assumptions.items()
        for assumption, each in failed.items()
    ]


def _violations(seen: list[messages.ViolationEvent], result: Result | None) -> dict[str, int]:
    """Return the result's counts, which have every rule; without a result, count the recorded violations."""
    counted = None if result is None else result.violations
    return _counted(each.rule for each in seen) if counted is None else dict(counted)


def _unknown(result: Result | None) -> str:
    if result is None:
        return "the run did not get to sum up what ground truth saw"
    if result.violations is None:
        return "there is no ground truth"
    ended_s = result.truth_ended_s
    return "" if ended_s is None else f"ground truth ended at {ended_s:.2f} s"
