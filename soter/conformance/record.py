"""The result of a run of the kit: outcomes and the overall verdict, as JSON and JUnit XML."""

from __future__ import annotations

import hashlib
import importlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from functools import cache
from importlib.metadata import packages_distributions, version
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

from soter.conformance.bench import Bench
from soter.conformance.clause import Clause, Tier
from soter.conformance.figure import Figure

KIT_VERSION: Final = "2.34"
"""Changes whenever an adapter that conformed might no longer do so."""

NOT_DECLARED: Final = "not declared: "
"""How the reason begins if a clause needs a capability that is not declared."""


class Verdict(Enum):
    """The verdict of one clause on an adapter."""

    PASS = "PASS"  # noqa: S105 - no password
    FAIL = "FAIL"
    NOT_TESTED = "NOT TESTED"


class Overall(Enum):
    """The verdict of all clauses together."""

    CONFORMS = "CONFORMS"
    SELF_REPORTED = "CONFORMS (self-reported)"
    FAILS = "DOES NOT CONFORM"
    AS_FAR = "CONFORMS AS FAR AS IT COULD BE TRIED (the kit did not start the robot)"
    PARTIAL = "NOT JUDGED (a selection of clauses)"
    UNFINISHED = "NOT JUDGED (ended before all clauses were tried)"


@dataclass(frozen=True, slots=True)
class Outcome:
    """One clause and its result.

    Attributes:
        clause: the clause.
        verdict: its verdict.
        reason: why it failed or was not tested; empty if it passed.
        figures: the measured figures.
        host_s: how long the clause took.
        unready: whether it failed before any robot was ready, so that all others probably will, too.
    """

    clause: Clause
    verdict: Verdict
    reason: str
    figures: tuple[Figure, ...]
    host_s: float
    unready: bool = False


@dataclass(frozen=True, slots=True)
class Subject:
    """The adapter that the outcomes are about.

    Attributes:
        robot_class: the class of its robots, as `module:Class`.
        distribution: the installed distribution with its version; empty if the adapter was not installed.
        capabilities: what the robots declare.
        in_process: whether they live in this process.
    """

    robot_class: str
    distribution: str
    capabilities: dict[str, Any]
    in_process: bool


@dataclass(frozen=True, slots=True)
class Record:
    """The result of a run of the kit; without a subject if no robot got ready."""

    adapter: str
    subject: Subject | None
    outcomes: tuple[Outcome, ...]
    overall: Overall

    def count(self, verdict: Verdict) -> int:
        """Return how many clauses have a verdict."""
        return Counter(outcome.verdict for outcome in self.outcomes)[verdict]

    def as_dict(self) -> dict[str, Any]:
        """Return the record as plain data, with a hash over all of it but the clauses' times."""
        content: dict[str, Any] = {
            "kit_version": KIT_VERSION,
            "adapter": self.adapter,
            "subject": None if self.subject is None else asdict(self.subject),
            "verdict": self.overall.value,
            "clauses": [
                {
                    "id": outcome.clause.id,
                    "tier": outcome.clause.tier.value,
                    "contract": outcome.clause.contract,
                    "verdict": outcome.verdict.value,
                    "reason": outcome.reason,
                    "figures": [asdict(figure) for figure in outcome.figures],
                }
                for outcome in self.outcomes
            ],
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        host_s = {outcome.clause.id: round(outcome.host_s, 3) for outcome in self.outcomes}
        return {**content, "sha256": hashlib.sha256(text.encode()).hexdigest(), "host_s": host_s}

    def as_junit(self) -> str:
        """Return the record as JUnit XML, one case a clause."""
        failures, skipped = self.count(Verdict.FAIL), self.count(Verdict.NOT_TESTED)
        suite = Element(
            "testsuite",
            name=f"soter conform {self.adapter}",
            tests=str(len(self.outcomes)),
            failures=str(failures),
            skipped=str(skipped),
            time=f"{sum(outcome.host_s for outcome in self.outcomes):.3f}",
        )
        for outcome in self.outcomes:
            case = SubElement(
                suite, "testcase", classname=outcome.clause.group, name=outcome.clause.id, time=f"{outcome.host_s:.3f}"
            )
            if outcome.verdict is not Verdict.PASS:
                tag = "failure" if outcome.verdict is Verdict.FAIL else "skipped"
                SubElement(case, tag, message=outcome.reason)
        return tostring(suite, encoding="unicode", xml_declaration=True)


def overall(outcomes: Sequence[Outcome], *, in_process: bool, given: bool = False) -> Overall:
    """Return the overall verdict.

    Core clauses must pass, and unless the robots live in this process those of the wire tier too. Clauses that need a
    capability that is not declared do not count. Without the truth clauses the verdict is only self-reported. For a
    robot that the kit did not start, clauses that could not be tried limit the verdict.
    """
    verdict = Overall.CONFORMS
    for outcome in outcomes:
        tier, missing = outcome.clause.tier, outcome.verdict is Verdict.NOT_TESTED
        if outcome.verdict is Verdict.FAIL:
            return Overall.FAILS
        if not missing or outcome.reason.startswith(NOT_DECLARED):
            continue
        if given:
            verdict = Overall.AS_FAR
        elif tier is Tier.CORE or (tier is Tier.WIRE and not in_process):
            return Overall.FAILS
        elif tier is Tier.TRUTH:
            verdict = Overall.SELF_REPORTED
    return verdict


def make_record(
    adapter: str,
    subject: Subject | None,
    outcomes: Sequence[Outcome],
    *,
    complete: bool,
    finished: bool = True,
    given: bool = False,
) -> Record:
    """Return the record of a run.

    Args:
        adapter: the harness's name.
        subject: the adapter's robots; None if none got ready.
        outcomes: the outcome of each clause tried.
        complete: whether all existing clauses were selected.
        finished: whether all selected clauses were tried.
        given: whether the kit did not start the robot.
    """
    said = overall(outcomes, in_process=subject is not None and subject.in_process, given=given)
    if not (complete and finished) and not any(outcome.verdict is Verdict.FAIL for outcome in outcomes):
        said = Overall.PARTIAL if finished else Overall.UNFINISHED
    return Record(adapter, subject, tuple(outcomes), said)


def subject_of(bench: Bench) -> Subject | None:
    """Return the subject of a bench, or None if no robot got ready on it."""
    if bench.capabilities is None:
        return None
    kind = type(bench.fleets[-1].robots[0])
    return Subject(
        robot_class=f"{kind.__module__}:{kind.__qualname__}",
        distribution=_distribution(kind.__module__.partition(".")[0]),
        capabilities=asdict(bench.capabilities),
        in_process=bench.capabilities.in_process,
    )


@cache
def _distribution(package: str) -> str:
    names = packages_distributions().get(package, [])
    if names:
        return f"{names[0]} {version(names[0])}"
    said = getattr(importlib.import_module(package), "__version__", None)
    return "" if said is None else f"{package} {said}"
