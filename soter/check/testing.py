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

from soter.check.conditions import Certainty, Finding, conditions
from soter.check.falsify import falsify
from soter.check.trial import TriedModule

OBLIGATIONS: Final = ("P1a", "P1b", "P2a", "P2b", "P3", "model")
"""`model`: in no trial did the margin fall by more than the module's model allows."""


class ModuleSuite:
    """One test for each obligation of a module.

    The trials are made once for a class. What is ASSUMED fails: a suite that tests nothing must not look like one that
    passes. A module given by predicates says so in `assumed`.

    Attributes:
        subject: makes what is tried, such as `soter.check.bench.floor_bench` with its arguments.
        budget: trials, at most.
        seed: everything random is drawn from it.
        assumed: obligations that are the author's word.
    """

    subject: ClassVar[Callable[[], TriedModule]]
    budget: ClassVar[int] = 100
    seed: ClassVar[int] = 0
    assumed: ClassVar[frozenset[str]] = frozenset()

    _found: ClassVar[dict[str, Finding] | None] = None

    def pytest_generate_tests(self, metafunc: Any) -> None:
        """Make a test of every obligation (pytest calls this on the class)."""
        if "obligation" in metafunc.fixturenames:
            metafunc.parametrize("obligation", OBLIGATIONS)

    def test_obligation(self, obligation: str) -> None:
        """Look at one obligation."""
        found = self._findings().get(obligation)
        if found is None:
            raise AssertionError(f"{obligation}: not looked at, because an earlier condition is rejected")
        fine = {Certainty.PROVED, Certainty.TESTED, *([Certainty.ASSUMED] if obligation in self.assumed else [])}
        if found.verdict not in fine:
            raise AssertionError(f"{found.module}, {obligation}: {found.verdict.value}: {found.text}")

    @classmethod
    def _findings(cls) -> dict[str, Finding]:
        """Return what is known about every obligation; worked out at the first test of the class."""
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
