"""The checks as tests: subclass `ModuleSuite` in a test file, and pytest runs one test for each obligation.

```python
class TestMyModule(ModuleSuite):
    subject = partial(floor_bench, "my_package.my_module:declare")
```

pytest itself is not imported here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Final

from soter.check.bench import ModuleBench
from soter.check.conditions import Certainty, Finding, conditions
from soter.check.falsify import falsify

OBLIGATIONS: Final = ("P1a", "P1b", "P2a", "P2b", "P3", "model")
"""`model`: in no trial did the margin fall by more than the module's model allows."""


class ModuleSuite:
    """One test for each obligation of a module.

    The trials are run once per class. An ASSUMED obligation fails: a suite that tests nothing must not look like one
    that passes. For a module given by predicates, list such obligations in `assumed`.

    Attributes:
        subject: makes the module under test, such as `soter.check.bench.floor_bench` with its arguments.
        budget: largest number of trials.
        seed: seed of all random numbers.
        assumed: obligations that may rest on the author's word.
    """

    subject: ClassVar[Callable[[], ModuleBench]]
    budget: ClassVar[int] = 100
    seed: ClassVar[int] = 0
    assumed: ClassVar[frozenset[str]] = frozenset()

    _found: ClassVar[dict[str, Finding] | None] = None

    def pytest_generate_tests(self, metafunc: Any) -> None:
        """Make one test per obligation (pytest calls this on the class)."""
        if "obligation" in metafunc.fixturenames:
            metafunc.parametrize("obligation", OBLIGATIONS)

    def test_obligation(self, obligation: str) -> None:
        """Fail unless the obligation is proved, tested, or listed in `assumed`."""
        found = self._findings().get(obligation)
        if found is None:
            raise AssertionError(f"{obligation}: not looked at, because an earlier condition is rejected")
        fine = {Certainty.PROVED, Certainty.TESTED, *([Certainty.ASSUMED] if obligation in self.assumed else [])}
        if found.verdict not in fine:
            raise AssertionError(f"{found.module}, {obligation}: {found.verdict.value}: {found.text}")

    @classmethod
    def _findings(cls) -> dict[str, Finding]:
        """Return the finding about every obligation; computed at the first test of the class."""
        if "_found" not in cls.__dict__ or cls._found is None:
            subject = cls.subject()
            found = {each.condition: each for each in conditions(subject.module, subject.timing, subject.base_tick_s)}
            if not any(each.verdict is Certainty.REJECTED for each in found.values()):
                tried, _ = falsify(subject, cls.budget, cls.seed)
                found |= {each.condition: each for each in tried if each.condition != "model"}
                fits = Finding(
                    subject.module.name, "model", Certainty.TESTED, "no margin fell by more than the model allows"
                )
                found["model"] = next((each for each in tried if each.condition == "model"), fits)
            cls._found = found
        return cls._found
