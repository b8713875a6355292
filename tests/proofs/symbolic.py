"""Runs plain arithmetic of the code on Z3's reals, along every branch it may take, and asks Z3 what comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import z3

Fact = Any
"""A Z3 formula; its stubs know no better."""

PATIENCE_MS: Final = 20000
"""Z3 gives up after so long; a test that it gives up on fails."""

FAR_M: Final = 1e9
"""Stands for infinity, which Z3's reals have not: farther than anything in a workspace."""


def positive(names: str) -> tuple[list[Any], list[Fact]]:
    """Return reals by these names, and that they are above 0."""
    reals = list(z3.Reals(names))
    return reals, [each > 0 for each in reals]


def counterexample(claim: Fact, given: Sequence[Fact]) -> Any:
    """Return values for which all of `given` holds and the claim does not, or None if there are none."""
    # The first is complete for polynomials; the second is quicker where a disjunction is large.
    for solver in (z3.Then("simplify", "solve-eqs", "qfnra-nlsat").solver(), z3.Solver()):
        solver.set("timeout", PATIENCE_MS)
        solver.add(*given, z3.Not(claim))
        answer = solver.check()
        if answer != z3.unknown:
            return solver.model() if answer == z3.sat else None
    raise AssertionError(f"Z3 does not know whether this holds: {claim}")


@dataclass(frozen=True)
class Branch:
    """One way through the code.

    Attributes:
        facts: what was given, and the conditions of this way.
        value: what the code returned; None where it refused.
        refusal: what it raised, or None.
    """

    facts: list[Fact]
    value: Any
    refusal: Exception | None = None


_DIVIDE: Final = z3.ArithRef.__truediv__
_WAYS: Final = z3.SolverFor("QF_LRA")
_LINEAR: Final[dict[int, tuple[Any, bool]]] = {}


class SymbolicMath:
    """Takes the place of the module `math`: roots, quotients and distances are new reals with the properties of those.

    Distances are known by their metric alone (they are not negative, symmetric, and keep the triangle inequality), so
    that what is proved of them holds on any ground.
    """

    inf = z3.RealVal(FAR_M)

    def __init__(self) -> None:
        self.facts: list[Fact] = []
        self._roots: list[tuple[Any, Any]] = []
        self._quotients: list[tuple[tuple[Any, Any], Any]] = []
        self._apart: dict[frozenset[str], Any] = {}
        self._points: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(math, name)

    def sqrt(self, square: Any) -> Any:
        """Return the root, a real whose square is this."""
        square = z3.simplify(square)
        for known, root in self._roots:
            if known.eq(square):
                return root
        root = z3.Real(f"root_{len(self._roots)}")
        self.facts += [root >= 0, root * root == square]
        self._roots.append((square, root))
        return root

    def quotient(self, value: Any, by: Any) -> Any:
        """Return a quotient: a real that makes the value again when it is multiplied."""
        by = z3.simplify(by) if z3.is_expr(by) else by
        if not z3.is_expr(by) or z3.is_rational_value(by):
            return _DIVIDE(value, by)
        value = z3.simplify(value)
        for (known, known_by), found in self._quotients:
            if known.eq(value) and known_by.eq(by):
                return found
        found = z3.Real(f"quotient_{len(self._quotients)}")
        self.facts.append(found * by == value)
        self._quotients.append(((value, by), found))
        return found

    def hypot(self, dx: Any, dy: Any) -> Any:
        """Return the length of a vector."""
        return self.sqrt(dx * dx + dy * dy)

    def dist(self, one: Sequence[Any], other: Sequence[Any]) -> Any:
        """Return the distance of two places."""
        for name in (str(one), str(other)):
            if name not in self._points:
                self._points.append(name)
        return self._between(str(one), str(other))

    def _between(self, one: str, other: str) -> Any:
        if one == other:
            return z3.RealVal(0)
        pair = frozenset((one, other))
        if pair not in self._apart:
            self._apart[pair] = z3.Real(f"dist_{len(self._apart)}")
            self.facts.append(self._apart[pair] >= 0)
        return self._apart[pair]

    def known(self) -> list[Fact]:
        """Return what is known of all roots, quotients and distances by now."""
        facts = []
        for three in combinations(self._points, 3):
            for far in three:
                near = [self._between(far, each) for each in three if each != far]
                one, other = (each for each in three if each != far)
                facts.append(self._between(one, other) <= near[0] + near[1])
        return self.facts + facts

    def ceil(self, value: Any) -> Any:
        """Return the value: only messages round it."""
        return value


def greatest(*values: Any) -> Any:
    """Take the place of `max`, for numbers and reals; of the elements of one argument where there is only one."""
    return _extreme(lambda one, other: z3.If(one >= other, one, other), max, values)


def least(*values: Any) -> Any:
    """Take the place of `min`, likewise."""
    return _extreme(lambda one, other: z3.If(one <= other, one, other), min, values)


def size(value: Any) -> Any:
    """Take the place of `abs`."""
    return greatest(value, -value)


def _extreme(choose: Callable[[Any, Any], Any], plain: Callable[..., Any], values: tuple[Any, ...]) -> Any:
    among = list(values[0]) if len(values) == 1 else list(values)
    found = among[0]
    for value in among[1:]:
        found = choose(found, value) if z3.is_expr(found) or z3.is_expr(value) else plain(found, value)
    return found


def holds(answer: Any) -> Fact:
    """Return what the code has answered as a formula."""
    return answer if z3.is_expr(answer) else z3.BoolVal(bool(answer))


class _Fork:
    """Decides every condition that the code asks about, one way and then the other."""

    def __init__(self, script: list[tuple[bool, bool]], given: Sequence[Fact], symbolic: SymbolicMath) -> None:
        self.taken: list[tuple[Fact, bool]] = []
        # Whether the other way is still to be gone.
        self._left: list[bool] = []
        self._script, self._given, self._math = script, given, symbolic
        self._certain = [
            (z3.simplify(fact if sure else z3.Not(fact)), sure) for fact in given for sure in (True, False)
        ]

    def decide(self, condition: Any) -> bool:
        condition = z3.simplify(condition)
        if z3.is_true(condition) or z3.is_false(condition):
            return bool(z3.is_true(condition))
        for known, answer in (*self._certain, *self.taken):
            if known.eq(condition):
                return answer
        if len(self.taken) < len(self._script):
            answer, left = self._script[len(self.taken)]
        else:
            answer = self._possible(condition)
            left = answer and self._possible(z3.Not(condition))
        self.taken.append((condition, answer))
        self._left.append(left)
        return answer

    def facts(self) -> list[Fact]:
        return [condition if answer else z3.Not(condition) for condition, answer in self.taken]

    def next_script(self) -> list[tuple[bool, bool]] | None:
        so_far = [(answer, left) for (_, answer), left in zip(self.taken, self._left, strict=True)]
        while so_far and not so_far[-1][1]:
            so_far.pop()
        return [*so_far[:-1], (False, False)] if so_far else None

    def _possible(self, condition: Fact) -> bool:
        # What is not linear takes long; a way that it excludes costs a question more.
        known = (*self._given, *self._math.facts, *self.facts(), condition)
        _WAYS.push()
        _WAYS.add(*(each for each in known if _linear(each)))
        possible = _WAYS.check() != z3.unsat
        _WAYS.pop()
        return bool(possible)


def _linear(formula: Any) -> bool:
    """Return whether a formula multiplies and divides by numbers only."""
    # Ids are used again for other formulas once one is gone: so it is kept.
    _, found = _LINEAR.get(formula.get_id(), (None, None))
    if found is None:
        parts = formula.children()
        unknown = [part for part in parts if not z3.is_rational_value(part)]
        product = (z3.is_mul(formula) and len(unknown) > 1) or (z3.is_div(formula) and len(unknown) > 0)
        found = not product and all(_linear(part) for part in parts)
        _LINEAR[formula.get_id()] = formula, found
    return found


@contextmanager
def _asked(fork: _Fork) -> Iterator[None]:
    """Have conditions be decided by the fork wherever Python asks whether they are true."""
    truth, text = z3.BoolRef.__bool__, z3.ExprRef.__format__
    z3.BoolRef.__bool__ = lambda condition: fork.decide(condition)
    z3.ExprRef.__format__ = lambda value, _: str(value)
    try:
        yield
    finally:
        z3.BoolRef.__bool__, z3.ExprRef.__format__ = truth, text


def branches(
    code: Callable[[], Any],
    given: Sequence[Fact],
    symbolic: SymbolicMath,
    refuses: type[Exception] | tuple[type[Exception], ...] = (),
) -> Iterator[Branch]:
    """Go every way through the code that what is given allows.

    Args:
        code: called once for every way; it may have no effect that the next call sees.
        given: what is known beforehand.
        symbolic: what the code's modules have in the place of `math`.
        refuses: how the code may end otherwise.
    """
    script: list[tuple[bool, bool]] | None = []
    while script is not None:
        fork = _Fork(script, given, symbolic)
        value, refusal = None, None
        with _asked(fork):
            try:
                value = code()
            except refuses as error:
                refusal = error
        yield Branch([*given, *fork.facts()], value, refusal)
        script = fork.next_script()
