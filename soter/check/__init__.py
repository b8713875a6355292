"""Systematic checks of safety modules: conditions, proofs over covers, falsification. What to test is handed in."""

from soter.check.conditions import conditions
from soter.check.counterexample import Counterexample, read_counterexample
from soter.check.cover import OUTSIDE, Cell, Cover, Judged, Status, cover
from soter.check.falsify import Falsified, falsify
from soter.check.search import Found, search
from soter.check.trial import Breach, Obligation, Row, Subject, Trial
from soter.check.verdict import Finding, Verdict

__all__ = [
    "OUTSIDE",
    "Breach",
    "Cell",
    "Counterexample",
    "Cover",
    "Falsified",
    "Finding",
    "Found",
    "Judged",
    "Obligation",
    "Row",
    "Status",
    "Subject",
    "Trial",
    "Verdict",
    "conditions",
    "cover",
    "falsify",
    "read_counterexample",
    "search",
]
