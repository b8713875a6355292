"""The argument in docs/assurance.md is about this code: its assumptions, tests and clauses, and what its check says."""

from __future__ import annotations

import contextlib
import fnmatch
import importlib
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from soter.cli.app import app
from soter.conformance import CLAUSES
from soter.controllers import ADVERSARIES
from soter.faults import BUILT_IN as FAULTS
from soter.rta.assumptions import Assumption
from tests.project.markdown import blocks
from tests.project.source import ROOT

PAGE: Path = ROOT / "docs" / "assurance.md"
TEXT = PAGE.read_text(encoding="utf-8")


def row(assumption: Assumption) -> list[str]:
    """The cells of an assumption's row: number, statement, monitor, attacks."""
    (line,) = [line for line in TEXT.splitlines() if line.startswith(f"| {assumption.id} |")]
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.parametrize("assumption", Assumption, ids=str)
def test_every_assumption_stands_there_in_the_codes_words(assumption: Assumption) -> None:
    number, statement, monitor, _ = row(assumption)
    assert (number, statement, monitor) == (assumption.id, assumption.statement, assumption.monitor)


@pytest.mark.parametrize("assumption", Assumption, ids=str)
def test_what_attacks_an_assumption_is_there(assumption: Assumption) -> None:
    attacks = re.findall(r"`([^`]+)`", row(assumption)[3])
    # The file is named after the test.
    tests = re.findall(r"^def (test_\w+)", (ROOT / attacks[1]).read_text(encoding="utf-8"), re.MULTILINE)
    assert attacks[0].startswith(f"test_a{assumption.id[1:]}_")
    for attack in attacks:
        if attack.startswith("test_"):
            # One test may attack two assumptions: test_a5_a11_...
            assert any(f"_{assumption.id.lower()}_" in test for test in tests), attack
        elif "/" in attack:
            assert (ROOT / attack).exists(), attack
        elif "." in attack:
            assert fnmatch.filter(CLAUSES, attack), attack
        else:
            assert attack in FAULTS or attack in ADVERSARIES or attack == "soter check", attack


def test_the_tests_that_stand_for_the_lemmas_are_there() -> None:
    for path in re.findall(r"`((?:tests|benchmarks|examples)/[\w./-]+)`", TEXT):
        assert (ROOT / path).exists(), path


def _named() -> set[str]:
    """What the page names of the code: modules, classes and what they have, functions of a module."""
    lines = re.findall(r"^    .* ([A-Za-z]\w*\.\w+)$", TEXT, re.MULTILINE)
    return {
        name for name in (*re.findall(r"`([\w.]+)`", TEXT), *lines) if re.match(r"soter\.|declaration\.|[A-Z]", name)
    }


@pytest.mark.parametrize("name", sorted(_named()))
def test_the_code_that_computes_a_lemma_is_there(name: str) -> None:
    """A module or what it has by its full name; a class, a constant, and what they have, wherever in the package."""
    if name.startswith("soter."):
        module, _, last = name.rpartition(".")
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module(name)
            return
        assert hasattr(importlib.import_module(module), last)
        return
    owner, _, member = name.partition(".")
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "soter").rglob("*.py")]
    if owner == "declaration":
        sources, owner = [(ROOT / "soter" / "stack" / "declaration.py").read_text(encoding="utf-8")], member
    found = [each for each in sources if re.search(rf"^(class|def) {owner}\b|^{owner}\b", each, re.MULTILINE)]
    assert any(not member or re.search(rf"(def |self\.| ){member}\b", each) for each in found)


def test_the_thesis_is_found_ill_formed_as_shown() -> None:
    (block,) = [block for block in blocks(PAGE) if "thesis.toml" in block.code]
    done = CliRunner().invoke(app, ["check", str(ROOT / "examples" / "thesis.toml")], env={"COLUMNS": "300"})
    assert done.exit_code == 1
    said = [" ".join(line.split()) for line in done.stdout.splitlines()]
    shown = [" ".join(line.split()) for line in block.code.splitlines() if not line.startswith("$")]
    assert len(shown) == 3
    assert not [line for line in shown if line not in said]
