"""Measures a robot with the clauses of the kit, and advises what it should promise."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from pydantic import ValidationError

from soter.conformance.clause import CLAUSES, Clause
from soter.conformance.given import Given
from soter.conformance.measured import measured_of
from soter.conformance.promises import MEASURED_BY
from soter.conformance.record import Outcome, Record, Verdict
from soter.conformance.workshop import Workshop
from soter.registry import load_backend
from soter.sdk import Capabilities
from soter.sdk.capabilities import ABOVE_0, WIDENS, Widens

_FIRST: Final = ("bounds.rest", "truth.bounds.noise", "goto.v_max")
"""Measured first, since the other clauses depend on their figures."""

_THEN: Final = (
    "state.age", "bounds.jitter", "bounds.latency", "bounds.tube", "bounds.overshoot", "bounds.yaw_rate",
    "deadman.lease", "bounds.braking", "bounds.acceleration", "truth.bounds.velocity",
)  # fmt: skip

STEPS: Final = len(_FIRST) + len(_THEN)
"""How many clauses measure."""

_WITNESS: Final = "truth.bounds.noise"

_CHOSEN: Final[Mapping[str, float]] = {
    "v_max_m_s": 0.8, "yaw_rate_max_rad_s": 0.8, "lease_s": 0.0, "setpoint_period_s": 0.0
}  # fmt: skip
"""Promises that are chosen: they stay as they are if the robot keeps them and uses at least this share of them."""

_DIGITS: Final = 3
_STEP: Final = 1e-4
_PASSES: Final = 2
_LEAST: Final = 0.01


@dataclass(frozen=True, slots=True)
class Advice:
    """One promise, its measured value, and the advised one.

    Attributes:
        name: the capability, with its unit.
        promised: what the robot declares now.
        measured: the worst measured value; None if there is none.
        declared: the advised declaration, with the margin; the present one if nothing was measured.
        clause: the clause that measured it.
        judge: the source of the figure, the truth or the robot's own estimate; empty if nothing was measured.
    """

    name: str
    promised: float
    measured: float | None
    declared: float
    clause: str = ""
    judge: str = ""


@dataclass(frozen=True)
class Survey:
    """The result of measuring a robot.

    Attributes:
        record: the record of the clauses that measured.
        advice: on every promise that is a number; empty if no robot got ready.
        table: the options of the advised promise table, for what was measured.
    """

    record: Record
    advice: Sequence[Advice]
    table: Mapping[str, float]

    @property
    def complete(self) -> bool:
        """Whether no clause failed, so that no figures are missing."""
        return bool(self.advice) and self.record.count(Verdict.FAIL) == 0


def survey(
    given: Given,
    margin: float,
    stop: Callable[[], bool] = lambda: False,
    on_outcome: Callable[[Outcome, Record], None] | None = None,
) -> Survey:
    """Drive a robot about its room, and measure what it may promise.

    Args:
        given: the robot; measuring begins with its promises, which are widened if they turn out too good.
        margin: the margin added to each figure, as a share of it.
        stop: polled; once it returns True, the robot is stopped, and the figures up to then count.
        on_outcome: called with each clause's outcome.
    """
    given = replace(given, judges=False)
    first = _tried(given, [CLAUSES[key] for key in _FIRST], stop, on_outcome)
    figures = {each.name: each.measured for each in measured_of(first) if each.measured is not None}
    sees = any(each.clause.id == _WITNESS and each.verdict is Verdict.PASS for each in first.outcomes)
    twins = (f"truth.{key}" for key in _THEN)
    then = [CLAUSES[twin if sees and twin in CLAUSES else key] for key, twin in zip(_THEN, twins, strict=True)]
    second = _tried(_adjusted(given, figures), then, stop, on_outcome)
    record = replace(first, outcomes=(*first.outcomes, *second.outcomes))
    return Survey(record, *_advised(given, record, margin))


def _tried(
    given: Given,
    clauses: Sequence[Clause],
    stop: Callable[[], bool],
    on_outcome: Callable[[Outcome, Record], None] | None,
) -> Record:
    with Workshop(given, stop=stop) as workshop:
        return workshop.judge(clauses, on_outcome)


def _adjusted(given: Given, seen: Mapping[str, float]) -> Given:
    """Return the robot with promises widened to the figures, and with no top speed that it does not come near."""
    promised = given.spec.promised
    assert promised is not None
    worse = {name: value for name, value in seen.items() if value > getattr(promised, name, math.inf)}
    fastest = seen.get("v_max_m_s")
    if fastest is not None and fastest < _CHOSEN["v_max_m_s"] * promised.v_max_m_s:
        worse["v_max_m_s"] = fastest
    return given.promising(**worse)


def _advised(given: Given, record: Record, margin: float) -> tuple[Sequence[Advice], Mapping[str, float]]:
    failed = {each.clause.id.removeprefix("truth.") for each in record.outcomes if each.verdict is Verdict.FAIL}
    # A failed clause may have missed the worst value, whatever others measured.
    unknown = {name for name, (by, _) in MEASURED_BY.items() if failed & {key.removeprefix("truth.") for key in by}}
    advice = []
    for each in measured_of(record):
        if each.measured is None or each.name in unknown:
            advice.append(Advice(each.name, each.promised, None, each.promised))
            continue
        better = _spared(each.name, each.measured, margin)
        if _CHOSEN.get(each.name, math.inf) * each.promised <= each.measured <= each.promised:
            better = each.promised
        judge = "truth" if each.clause.startswith("truth.") else "own estimate"
        advice.append(Advice(each.name, each.promised, each.measured, better, each.clause, judge))
    table = _table(given, {each.name: each.declared for each in advice if each.measured is not None})
    # Promises that the backend has no option for stay as they are.
    return [each if each.name in table else replace(each, declared=each.promised) for each in advice], table


def _spared(name: str, measured: float, margin: float) -> float:
    """Return a figure widened by a margin and rounded to the safe side."""
    down = WIDENS[name] is Widens.DOWN
    value = measured * (1.0 - margin if down else 1.0 + margin)
    if value <= 0.0:
        return 0.0
    return _rounded(value, 10.0 ** max(math.floor(math.log10(value)) + 1 - _DIGITS, -4), down=down)


def _rounded(value: float, step: float, *, down: bool) -> float:
    return round((math.floor if down else math.ceil)(round(value / step, 6)) * step, 9)


def _table(given: Given, wanted: Mapping[str, float]) -> Mapping[str, float]:
    """Return the promise options with which robots declare the wanted values; backends add to and scale them."""
    backend, config = load_backend(given.backend), given.config

    def declared(**told: float) -> Capabilities:
        promise = config.promise.model_copy(update=told)
        return backend.promises(config.model_copy(update={"promise": promise}))

    told = {name: max(value, _STEP) if name in ABOVE_0 else value for name, value in wanted.items()}
    for _ in range(_PASSES):
        # Options also add to each other's declarations, which the second pass corrects for.
        for name, value in wanted.items():
            low = max(value, _LEAST)
            at_low, at_high = (getattr(declared(**{**told, name: each}), name) for each in (low, 2.0 * low))
            if at_high > at_low:
                needed = max(low + low * (value - at_low) / (at_high - at_low), 0.0)
                told[name] = _rounded(needed, _STEP, down=WIDENS[name] is Widens.DOWN)
    given_options = {key: getattr(config, key) for key in config.model_fields_set}
    while True:
        try:
            type(config).model_validate({**given_options, "promise": told})
        except ValidationError as failure:
            # Some rules are only checked once others hold: validate again.
            refused = {str(part) for error in failure.errors() for part in error["loc"]} & told.keys()
            told = {name: value for name, value in told.items() if name not in refused}
            if refused:
                continue
        return told
