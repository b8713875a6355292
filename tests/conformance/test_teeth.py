"""The kit fails every broken adapter by the clause that is meant for it, and passes those that are right."""

from __future__ import annotations

import re
import statistics
from dataclasses import fields

import pytest

from soter.conformance import (
    CLAUSES,
    HOOKS,
    Harness,
    Overall,
    Record,
    Tier,
    Verdict,
    find_harness,
    judge,
    select,
    try_clause,
)
from soter.conformance.harness import EXTRA_HOOKS
from soter.conformance.promises import MEASURED_BY
from soter.conformance.record import overall
from soter.sdk import Capabilities, RobotState
from tests.broken.goals import NoOpStop
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.table import BROKEN, PAGE, TABLES, Kind, outcome_of
from tests.conformance.simulated import SimulatedHarness
from tests.conformance.wire import WireHarness, WireRobot


class DeadSamples(Broken):
    """Is not heard any more after a second, and does nothing."""

    def _sample(self) -> RobotState:
        self.__dict__.setdefault("last", self._honest())
        if self.clock.now() < 1.0:
            self.__dict__["last"] = self._honest()
        else:
            self._mux.halt()
        return self.__dict__["last"]  # type: ignore[no-any-return]


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_every_broken_adapter_is_failed_by_the_clause_meant_for_it(kind: Kind) -> None:
    outcome = outcome_of(kind, kind.caught_by)
    assert outcome.verdict is Verdict.FAIL
    # What was seen, and what the likely cause is: a message that only says "failed" helps nobody.
    assert re.fullmatch(r".{10,}: .{15,}|.+ raised nothing, expected .+|.+\(raised in .+\)", outcome.reason)
    assert re.search(getattr(kind, "blames", ""), outcome.reason), outcome.reason


def test_there_are_many_of_them_and_each_says_what_is_wrong() -> None:
    assert len(BROKEN) >= 180
    assert all(kind.__doc__ and kind.__doc__.endswith(".") and kind.caught_by in CLAUSES for kind in BROKEN)
    assert len({(kind.__doc__, issubclass(kind, BrokenWire)) for kind in BROKEN}) == len(BROKEN)


def test_every_promise_is_measured_by_a_clause_and_every_one_that_is_too_good_is_found_out() -> None:
    assert set(MEASURED_BY) == {field.name for field in fields(Capabilities)}
    assert {each for clauses, _ in MEASURED_BY.values() for each in clauses} <= set(CLAUSES)
    caught = {kind.caught_by.removeprefix("truth.") for kind in BROKEN}
    for name, (clauses, _) in MEASURED_BY.items():
        assert caught & {each.removeprefix("truth.") for each in clauses}, f"no broken adapter breaks its {name}"


@pytest.mark.parametrize("kind", [DeadSamples, NoOpStop], ids=lambda kind: kind.__name__)
def test_an_adapter_that_is_dead_costs_seconds_a_clause(kind: type[Broken]) -> None:
    fleet_s = []
    for clause in select(["state", "goto", "goal"]):
        _, bench = try_clause(clause, SimulatedHarness(kind))
        fleet_s.append(bench.now_s if bench.fleets else 0.0)
    assert statistics.median(fleet_s) < 12.0


@pytest.mark.parametrize(
    ("engine", "only", "tiers", "least"),
    [
        ("kinematic", (), tuple(Tier), 140),
        # Rigid bodies take their time. The adapter is the same, so clauses about anything but motion have passed.
        pytest.param("pybullet", ("goto", "bounds"), (Tier.CORE,), 20, marks=pytest.mark.pybullet),
        pytest.param("pybullet", ("state", "goto", "bounds"), (Tier.TRUTH,), 20, marks=pytest.mark.pybullet),
    ],
    ids=["kinematic", "pybullet-core", "pybullet-truth"],
)
@pytest.mark.long
def test_the_reference_adapter_passes_every_core_and_truth_clause(
    engine: str, only: tuple[str, ...], tiers: tuple[Tier, ...], least: int
) -> None:
    if engine == "pybullet":
        pytest.importorskip("pybullet")
    record = judge(find_harness(engine), select(only, tiers=tiers))
    missing = [outcome for outcome in record.outcomes if outcome.verdict is not Verdict.PASS]
    assert [outcome.reason for outcome in missing if outcome.verdict is Verdict.FAIL] == []
    assert all(each.clause.tier is Tier.WIRE or each.reason.startswith("not declared: ") for each in missing)
    assert overall(record.outcomes, in_process=True) is Overall.CONFORMS
    assert record.count(Verdict.PASS) >= least
    assert_no_figure_is_beyond_its_bound(record)


@pytest.mark.long
def test_a_right_adapter_behind_a_link_passes_every_clause_of_the_link() -> None:
    # What is the same without a link has passed without it.
    record = judge(WireHarness(WireRobot), select(["link", "process", "deadman", "several", "authority", "goal"]))
    missing = {outcome.clause.id: outcome.verdict for outcome in record.outcomes if outcome.verdict is not Verdict.PASS}
    left_out = {"process.killed", "process.hung", "process.ends", "deadman.off_and_on"}
    assert missing == dict.fromkeys(left_out, Verdict.NOT_TESTED)
    # On a wire the first two may not be left out.
    assert overall(record.outcomes, in_process=False) is Overall.FAILS
    assert_no_figure_is_beyond_its_bound(record)


def assert_no_figure_is_beyond_its_bound(record: Record) -> None:
    for outcome in record.outcomes:
        for figure in outcome.figures if outcome.verdict is Verdict.PASS else ():
            if figure.bound is not None:
                beyond = figure.bound - figure.value if figure.at_least else figure.value - figure.bound
                assert beyond <= 1e-9, (outcome.clause.id, figure)


def test_every_hook_is_a_method_of_the_harness_that_some_clause_needs() -> None:
    assert all(hasattr(Harness, hook) for hook in HOOKS)
    assert {hook for clause in CLAUSES.values() for hook in clause.hooks} == set(HOOKS)
    assert all(WireHarness(WireRobot).gives(hook) for hook in EXTRA_HOOKS)


def test_the_page_shows_every_table_as_it_is() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name, table in TABLES.items():
        assert f"<!-- {name} -->\n\n{table()}\n\n<!--" in page, "write the page anew with: python -m tests.broken"
