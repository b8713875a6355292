"""The kit as tests: subclass `AdapterSuite` in a test file, and pytest runs one test for each clause.

```python
class TestMyRobot(AdapterSuite):
    harness = MyHarness
```

pytest itself is not imported here.
"""

from __future__ import annotations

import unittest
from collections.abc import Callable
from typing import Any, ClassVar

from soter.conformance.clause import CLAUSES, Tier
from soter.conformance.harness import Harness
from soter.conformance.kit import try_clause
from soter.conformance.record import Overall, Verdict, overall, subject_of
from soter.conformance.tally import Tally


class AdapterSuite:
    """One test for each clause.

    A clause that is NOT TESTED is skipped if the adapter may conform without it, and fails otherwise. Once robots have
    failed to get ready twice, no more clauses are tried.

    Attributes:
        harness: returns a harness, such as its class does; called for every test.
    """

    harness: ClassVar[Callable[[], Harness]]
    _tried: ClassVar[Tally]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls._tried = Tally(cls.__name__, ())

    def pytest_generate_tests(self, metafunc: Any) -> None:
        """Make a test of every clause (pytest calls this on the class)."""
        if "clause_id" in metafunc.fixturenames:
            metafunc.parametrize("clause_id", list(CLAUSES))

    def test_clause(self, clause_id: str) -> None:
        """Try one clause on a fresh fleet."""
        clause = CLAUSES[clause_id]
        tried = self._tried
        if tried.hopeless():
            raise AssertionError(f"{clause_id}: {clause.contract}\n{Verdict.NOT_TESTED.value}: {tried.hopeless()}")
        outcome, bench = try_clause(clause, type(self).harness())
        tried.add(outcome, subject_of(bench))
        if outcome.verdict is Verdict.PASS:
            return
        text = f"{clause_id}: {clause.contract}\n{outcome.verdict.value}: {outcome.reason}"
        if outcome.verdict is Verdict.NOT_TESTED:
            in_process = clause.tier is Tier.WIRE and _in_process(type(self).harness())
            if overall([outcome], in_process=in_process) is not Overall.FAILS:
                raise unittest.SkipTest(text)
        raise AssertionError(text)


def _in_process(harness: Harness) -> bool:
    fleet = harness.open(1)
    try:
        return fleet.robots[0].declared.in_process
    finally:
        fleet.close()
        harness.close()
