"""The promise table: for each capability the promised value, and the worst measured one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soter.conformance.record import Record
from soter.sdk.capabilities import WIDENS, Widens


@dataclass(frozen=True, slots=True)
class Measured:
    """One capability, as declared and as measured at worst; a share of the promise above 1 breaks the promise."""

    name: str
    promised: float
    measured: float | None = None
    share: float | None = None
    clause: str = ""


def measured_of(record: Record) -> list[Measured]:
    """Return every capability that is a number, in the order of `Capabilities`; none if no robot got ready."""
    declared = {} if record.subject is None else record.subject.capabilities
    found = {
        name: Measured(name, value)
        for name, value in declared.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    for outcome in record.outcomes:
        for figure in outcome.figures:
            known = found.get(figure.name)
            if known is None:
                continue
            share = _share(figure.name, figure.value, known.promised)
            if known.share is None or share > known.share:
                found[figure.name] = Measured(figure.name, known.promised, figure.value, share, outcome.clause.id)
    return list(found.values())


def _share(name: str, measured: float, promised: float) -> float:
    # Of some capabilities, such as brakes, the least value is the worst.
    part, whole = (promised, measured) if WIDENS[name] is Widens.DOWN else (measured, promised)
    if whole == 0.0:
        return 0.0 if part == 0.0 else math.inf
    return part / whole
