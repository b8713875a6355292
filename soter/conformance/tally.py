"""What has come out so far: a record at any moment, and whether it is any use to go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from soter.conformance.clause import CLAUSES, Clause
from soter.conformance.record import Outcome, Record, Subject, Verdict, make_record

_UNREADY: Final = 2
_UNREADY_S: Final = 20.0


class Tally:
    """Collects outcomes in whatever order they come.

    Robots that were never ready cost seconds in all: after two clauses that failed for that, or 20 s of them, the
    rest are NOT TESTED.

    Args:
        adapter: the harness's name.
        clauses: that are to be tried.
        on_outcome: told of each outcome, and of the record with it.
        given: whether the robot was there already.
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
        """Take an outcome, and whom it was about if a robot got ready."""
        self._outcomes[outcome.clause.id] = outcome
        self._subject = self._subject or subject
        if self._on_outcome is not None:
            self._on_outcome(outcome, self.record())

    def hopeless(self) -> str:
        """Return why no other clause is worth its time; empty while each is."""
        unready = [each for each in self._outcomes.values() if each.unready]
        enough = len(unready) >= _UNREADY or sum(each.host_s for each in unready) > _UNREADY_S
        if self._subject is not None or not enough:
            return ""
        return f"no robot was ever ready, as {' and '.join(each.clause.id for each in unready)} found"

    def give_up(self, clauses: Iterable[Clause]) -> None:
        """Take clauses as not tested, since it is hopeless."""
        reason = self.hopeless()
        for each in clauses:
            self.add(Outcome(each, Verdict.NOT_TESTED, reason, (), 0.0), None)

    def record(self) -> Record:
        """Return the record of what there is, in the order of the clauses."""
        outcomes = [self._outcomes[each.id] for each in self.clauses if each.id in self._outcomes]
        return make_record(
            self._adapter,
            self._subject,
            outcomes,
            complete=len(self.clauses) == len(CLAUSES),
            finished=len(outcomes) == len(self.clauses),
            given=self._given,
        )
