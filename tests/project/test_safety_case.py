"""The failure modes in docs/safety-case.md are about this tree: what they name exists, and none is left out."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

import pytest

from soter.conformance import CLAUSES
from soter.controllers import ADVERSARIES
from soter.faults import BUILT_IN as FAULTS
from soter.rta.assumptions import Assumption
from soter.stack.declaration import GEOFENCE, OBSTACLE
from soter.stack.right_of_way import BATTERY, COLLISION
from tests.project.source import ROOT

TEXT = (ROOT / "docs" / "safety-case.md").read_text(encoding="utf-8")
OWN = "own"
RULES = {GEOFENCE, OBSTACLE, COLLISION, BATTERY, OWN}
KINDS = {"fault": set(FAULTS), "adversary": set(ADVERSARIES), "clause": set(CLAUSES)}


def _rows() -> dict[str, list[str]]:
    table = TEXT.partition("<!-- failure modes:")[2].partition("## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines() if line[:1] == "|"]
    return {mode.strip(): rest for mode, *rest in rows[2:]}


ROWS = _rows()
BY_NUMBER = {each.id: each for each in Assumption}


def listed(cell: str) -> set[str]:
    """The names of a cell that lists plain ones."""
    return {name.strip() for name in cell.split(",")}


def quoted(cell: str) -> list[str]:
    """The names of a cell that lists quoted ones."""
    return re.findall(r"`([^`]+)`", cell)


def attacks(cell: str) -> dict[str, set[str]]:
    """What attacks a failure mode: by kind, the files and tests under 'tree'."""
    found: dict[str, set[str]] = {}
    for part in cell.split(";"):
        kind = part.strip().partition(" ")[0]
        found.setdefault(kind if kind in KINDS else "tree", set()).update(quoted(part))
    return found


@pytest.mark.parametrize("mode", ROWS)
def test_what_a_failure_mode_names_exists(mode: str) -> None:
    rules, _, assumed, _, attacked = ROWS[mode]
    assert listed(rules) <= RULES
    assert listed(assumed) <= set(BY_NUMBER)
    for kind, names in attacks(attacked).items():
        if kind != "tree":
            assert names <= KINDS[kind]
            continue
        for name in names:
            path, _, test = name.partition("::")
            source = (ROOT / path).read_text(encoding="utf-8")
            assert not test or re.search(rf"^def {test}\(", source, re.MULTILINE), name
    assert attacks(attacked).get("tree"), "no test attacks it"


@pytest.mark.parametrize("mode", ROWS)
def test_what_watches_an_assumption_notes_it(mode: str) -> None:
    _, _, assumed, watched, _ = ROWS[mode]
    sources = []
    for name in quoted(watched):
        module, _, owner = name.rpartition(".")
        sources.append(Path(inspect.getfile(getattr(importlib.import_module(module), owner))).read_text("utf-8"))
    for number in listed(assumed):
        assert any(f"Assumption.{BY_NUMBER[number].name}" in source for source in sources), number


def test_no_rule_assumption_fault_or_adversary_is_left_out() -> None:
    assert {rule for rules, *_ in ROWS.values() for rule in listed(rules)} == RULES
    assert {number for _, _, assumed, *_ in ROWS.values() for number in listed(assumed)} == set(BY_NUMBER)
    found = [attacks(attacked) for *_, attacked in ROWS.values()]
    for kind in ("fault", "adversary"):
        assert {name for each in found for name in each.get(kind, ())} == KINDS[kind]
    monitors = (ROOT / "soter" / "rta" / "monitors.py").read_text(encoding="utf-8")
    named = {name.rpartition(".")[2] for *_, watched, _ in ROWS.values() for name in quoted(watched)}
    assert set(re.findall(r"^class (\w+Monitor)\b", monitors, re.MULTILINE)) <= named
