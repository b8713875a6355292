"""Systematic checks of safety modules: conditions, falsification. What to test is handed in."""

from soter.check.conditions import Finding, Verdict, conditions
from soter.check.falsify import Falsified, Found, falsify, search
from soter.check.trial import Breach, Counterexample, Obligation, Row, Subject, Trial, read_counterexample

__all__ = [
    "Breach",
    "Counterexample",
    "Falsified",
    "Finding",
    "Found",
    "Obligation",
    "Row",
    "Subject",
    "Trial",
    "Verdict",
    "conditions",
    "falsify",
    "read_counterexample",
    "search",
]
