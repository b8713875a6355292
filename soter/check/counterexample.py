"""A counterexample as a file: what was tried, where it broke, and what happened tick by tick."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from soter.check.trial import Obligation, Row, Trial
from soter.errors import ConfigError
from soter.problems import read_limited

FORMAT: Final = "soter-counterexample"
VERSION: Final = 1

_TRACE_EVERY: Final = 5


@dataclass(frozen=True, slots=True)
class Counterexample:
    """What it takes to break a module again.

    Attributes:
        subject: what was tried, in terms of whoever made the subject.
        obligation: what broke.
        time_s: when.
        text: what happened.
        vector: the point of the search.
        trace_sha256: over all rows of the trial.
    """

    subject: Mapping[str, Any]
    obligation: Obligation
    time_s: float
    text: str
    vector: tuple[float, ...]
    trace_sha256: str

    def as_json(self, rows: Sequence[Row] = ()) -> str:
        """Return the content of its file; the rows are for people, a replay makes them anew."""
        return json.dumps(
            {
                "format": FORMAT,
                "version": VERSION,
                "subject": dict(self.subject),
                "obligation": self.obligation.value,
                "time_s": self.time_s,
                "text": self.text,
                "vector": list(self.vector),
                "trace_sha256": self.trace_sha256,
                "trace": [
                    {key: None if value != value else value for key, value in row._asdict().items()}
                    for row in rows[::_TRACE_EVERY]
                ],
            },
            indent=1,
            allow_nan=False,
        )


def trace_hash(trial: Trial) -> str:
    """Return the SHA-256 over all rows of a trial."""
    return hashlib.sha256("\n".join(map(repr, map(tuple, trial.rows))).encode()).hexdigest()


def read_counterexample(path: Path) -> Counterexample:
    """Read a counterexample's file.

    Raises:
        ConfigError: it is none, or of a version that this one does not read.
    """

    def refused(message: str) -> ConfigError:
        return ConfigError(f"{message}; give a file that `soter check --counterexample` wrote", source=str(path))

    try:
        found = json.loads(read_limited(path, "counterexample"))
    except (ValueError, RecursionError) as failure:
        raise refused(f"not valid JSON: {failure}") from failure
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise refused("this is no counterexample")
    if found.get("version") != VERSION:
        raise refused(f"it is of version {found.get('version')!r}, allowed: {VERSION}")
    try:
        vector = tuple(float(value) for value in found["vector"])
        if not vector or not all(math.isfinite(value) and 0.0 <= value <= 1.0 for value in vector):
            raise ValueError("the vector has to hold numbers from 0 to 1")
        return Counterexample(
            dict(found["subject"]), Obligation(found["obligation"]), float(found["time_s"]), str(found["text"]),
            vector, str(found["trace_sha256"]),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as failure:
        raise refused(f"something in it is missing or wrong: {failure!r}") from failure
