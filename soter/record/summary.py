"""What a recording holds, in figures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from soter.record.content import Content
from soter.record.messages import Violation
from soter.record.reader import Recording


@dataclass(frozen=True, slots=True)
class Summary:
    """A recording in figures.

    Attributes:
        file: its path.
        size_bytes: of the file.
        truncated: it was not closed; everything up to its last whole chunk is there.
        mission: the mission file.
        backend: name of the backend.
        seed: of the mission.
        started_utc: when, in ISO 8601.
        virtual_time: whether time stood still while nobody slept.
        duration_s: fleet time from the first recorded tick to the end of the last one.
        ticks: recorded.
        dropped_ticks: missing within, because the writer did not follow.
        robots: ids.
        modules: their names.
        ac_share: part of the robots' time in which their AC was in control.
        disengagements: by the module that fired first.
        switches: of any kind.
        goals: sent, by who sent them.
        targets: ended, by outcome.
        transitions: of the mission's machines.
        faults: what injected faults had spoilt at the end, by kind.
        violations: by rule, as ground truth saw them.
        status: how the run ended; None if it did not get to say so.
        versions: of SOTER and what it stands on.
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
    status: str | None
    versions: dict[str, str]


def summarise(recording: Recording, content: Content) -> Summary:
    """Return the figures of a recording.

    Args:
        recording: the file.
        content: all of it.
    """
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
        status=None if result is None else str(result.get("status")),
        versions=about.versions,
    )


def _counted(names: Any) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _violations(seen: list[Violation], result: dict[str, Any] | None) -> dict[str, int]:
    """Return the result's counts, which know every rule; without a result what was seen until then."""
    counted = (result or {}).get("violations")
    return dict(counted) if isinstance(counted, dict) else _counted(each.rule for each in seen)
