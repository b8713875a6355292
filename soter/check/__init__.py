"""Systematic checks of safety modules: conditions, falsification. What to test is handed in."""

from soter.check.conditions import Certainty, Finding, conditions
from soter.check.falsify import Falsified, Found, falsify, search
from soter.check.trial import (
    Attempt,
    BrokenObligation,
    Counterexample,
    Obligation,
    TrialRow,
    TriedModule,
    read_counterexample,
)

__all__ = [
    "Attempt",
    "BrokenObligation",
    "Certainty",
    "Counterexample",
    "Falsified",
    "Finding",
    "Found",
    "Obligation",
    "TrialRow",
    "TriedModule",
    "conditions",
    "falsify",
    "read_counterexample",
    "search",
]
