"""The kit fails every broken adapter by the clause that is meant for it, and passes those that are right."""

from __future__ import annotations

import re

import pytest

from soter.conformance import CLAUSES, HOOKS, Harness, Overall, Tier, Verdict, find_harness, judge
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.table import BROKEN, BROKEN_HEAD, PAGE, broken_row, clause_table, failed_by
from tests.conformance.wire import WireHarness, WireRobot


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_every_broken_adapter_is_failed_by_the_clause_meant_for_it(kind: type[Broken] | type[BrokenWire]) -> None:
    failed = failed_by(kind)
    assert kind.caught_by in failed
    # What was seen, and what the likely cause is: a message that only says "failed" helps nobody.
    assert re.fullmatch(r".{10,}: .{15,}|.+ raised nothing, expected .+", failed[kind.caught_by])
    assert broken_row(kind) in PAGE.read_text(encoding="utf-8"), "write the page anew with: python -m tests.broken"


def test_there_are_many_of_them_and_each_says_what_is_wrong() -> None:
    assert len(BROKEN) >= 40
    assert all(kind.__doc__ and kind.__doc__.endswith(".") and kind.caught_by in CLAUSES for kind in BROKEN)


@pytest.mark.parametrize("engine", ["kinematic", pytest.param("pybullet", marks=pytest.mark.pybullet)])
def test_the_reference_adapter_passes_every_core_and_truth_clause(engine: str) -> None:
    if engine == "pybullet":
        pytest.importorskip("pybullet")
    record = judge(find_harness(engine))
    tiers = {outcome.clause.tier for outcome in record.outcomes if outcome.verdict is not Verdict.PASS}
    assert [outcome.reason for outcome in record.outcomes if outcome.verdict is Verdict.FAIL] == []
    assert tiers == {Tier.WIRE}
    assert record.overall is Overall.CONFORMS
    assert record.count(Verdict.PASS) >= 90


def test_a_right_adapter_behind_a_link_passes_every_clause_of_the_link() -> None:
    record = judge(WireHarness(WireRobot))
    missing = {outcome.clause.id: outcome.verdict for outcome in record.outcomes if outcome.verdict is not Verdict.PASS}
    assert missing == {"process.killed": Verdict.NOT_TESTED, "process.hung": Verdict.NOT_TESTED}
    # On a wire these two may not be left out.
    assert record.overall is Overall.FAILS


def test_every_hook_is_a_method_of_the_harness_that_some_clause_needs() -> None:
    assert all(hasattr(Harness, hook) for hook in HOOKS)
    assert {hook for clause in CLAUSES.values() for hook in clause.hooks} == set(HOOKS)


def test_the_page_shows_every_clause_and_no_adapter_that_is_gone() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert f"\n{clause_table()}\n" in page, "write the page anew with: python -m tests.broken"
    rows = page.partition(BROKEN_HEAD)[2].partition("<!-- end of broken -->")[0].strip().splitlines()
    assert len(rows) == len(BROKEN)
