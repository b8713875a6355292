"""Collects outcomes: gives a record at any moment, and decides whether to go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from soter.conformance.clause import CLAUSES, Clause
from soter.conformance.record import Outcome, Record, Subject, Verdict, make_record

_UNREADY: Final = 2
_UNREADY_S: Final = 20.0


class Tally:
    """Collects outcomes in any order.

    If robots are never ready, it costs little time: after two clauses that failed for that, or 20 s of them, the rest
    are NOT TESTED.

    Args:
        adapter: the harness's name.
        clauses: the clauses to try.
        on_outcome: called with each outcome and the record so far.
        given: whether the kit did not start the robot.
    """

    def __init__(
        self,
        adapter: str,
        clauses: Iterable[Clause],
        on_outcome: Callable[[Outcome, Record], None] | None = None,
        *,
        given: bool = False,
    ) -> None:
        self._given: Final = given
        self.clauses: Final = tuple(clauses)
        self._adapter: Final = adapter
        self._on_outcome: Final = on_outcome
        self._outcomes: Final[dict[str, Outcome]] = {}
        self._subject: Subject | None = None

    def add(self, outcome: Outcome, subject: Subject | None) -> None:
        """Add an outcome, and its subject if a robot got ready."""
        self._outcomes[outcome.clause.id] = outcome
        self._subject = self._subject or subject
        if self._on_outcome is not None:
            self._on_outcome(outcome, self.record())

    def hopeless(self) -> str:
        """Return why no other clause is worth its time; empty while they are."""
        unready = [each for each in self._outcomes.values() if each.unready]
        enough = len(unready) >= _UNREADY or sum(each.host_s for each in unready) > _UNREADY_S
        if self._subject is not None or not enough:
            return ""
        return f"no robot was ever ready, as {' and '.join(each.clause.id for each in unready)} found"

    def give_up(self, clauses: Iterable[Clause]) -> None:
        """Add clauses as NOT TESTED, for the reason that `hopeless` returns."""
        reason = self.hopeless()
        for each in clauses:
            self.add(Outcome(each, Verdict.NOT_TESTED, reason, (), 0.0), None)

    def record(self) -> Record:
        """Return the record of the outcomes so far, in the order of the clauses."""
        outcomes = [self._outcomes[each.id] for each in self.clauses if each.id in self._outcomes]
        return make_record(
            self._adapter,
            self._subject,
            outcomes,
            complete=len(self.clauses) == len(CLAUSES),
            finished=len(outcomes) == len(self.clauses),
            given=self._given,
        )
