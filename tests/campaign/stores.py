"""Two stores of one campaign, compared."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any, Final

SAME: Final = (
    "id", "part", "number", "counted", "mission", "seed", "axes", "settings", "command", "status", "failure",
    "findings", "duration_s", "robots", "robot_hours", "violations", "contacts", "ac_share", "disengagements",
    "targets_reached", "longest_stall_s", "no_progress_s", "least_margin", "trace_sha256", "result",
)  # fmt: skip
"""The columns in which two stores of one campaign agree, however often either was killed."""


def same(store: Path) -> list[tuple[Any, ...]]:
    """All that two stores of one campaign agree in."""
    query = f"SELECT {', '.join(SAME)} FROM runs WHERE counted ORDER BY part, number"  # noqa: S608
    with closing(sqlite3.connect(store)) as sql:
        return sql.execute(query).fetchall()
