"""The store of a campaign's runs: one SQLite file, which pandas and DuckDB can read."""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, Self

from soter.campaign.job import Done, Job
from soter.errors import ConfigError, RunFailed

VERSION: Final = 1
_APPLICATION: Final = 0x50_7E_12
"""Distinguishes SQLite files of campaigns from others."""

_SCHEMA: Final = """
CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE runs (
    id TEXT PRIMARY KEY,
    part TEXT NOT NULL,
    number INTEGER NOT NULL,      -- its place in its part
    counted INTEGER NOT NULL,     -- whether the campaign, as it is now, has it, and had not had enough before it
    mission TEXT NOT NULL,
    seed INTEGER NOT NULL,
    axes TEXT NOT NULL,           -- JSON: what tells it from the others
    settings TEXT NOT NULL,       -- JSON
    command TEXT NOT NULL,        -- repeats it
    status TEXT NOT NULL,         -- done, refused or failed
    failure TEXT NOT NULL,
    traceback TEXT NOT NULL,
    findings TEXT NOT NULL,       -- JSON: what a second judge says must not be
    duration_s REAL,
    robots INTEGER,
    robot_hours REAL,
    violations INTEGER,           -- of all rules, by ground truth
    contacts INTEGER,
    ac_share REAL,
    disengagements INTEGER,
    targets_reached INTEGER,
    longest_stall_s REAL,
    no_progress_s REAL,
    least_margin REAL,
    trace_sha256 TEXT NOT NULL,   -- over all states and decisions
    result TEXT,                  -- JSON: as `soter run --json`, without what the host has a say in
    host TEXT NOT NULL,           -- JSON: the rest of it
    wall_s REAL
);
CREATE INDEX by_part ON runs (part, number);
"""


@dataclass(frozen=True)
class RunRow:
    """A finished run; the attributes are the columns that are not in `result`, see also `Job` and `Done`."""

    id: str
    part: str
    number: int
    mission: str
    seed: int
    axes: Mapping[str, str]
    settings: Mapping[str, Any]
    command: str
    status: str
    failure: str
    traceback: str
    findings: Sequence[str]
    robot_hours: float
    trace_sha256: str
    result: Mapping[str, Any]
    host: Mapping[str, Any]

    @property
    def violations(self) -> Mapping[str, int] | None:
        """Violations by rule, by ground truth; None without it."""
        return self.result.get("violations")


_COLUMNS: Final = tuple(field.name for field in fields(RunRow))
_JSON: Final = ("axes", "settings", "findings", "result", "host")


class Store:
    """The finished runs of a campaign. One process writes; any number may read meanwhile.

    Args:
        write: whether to write the file, and to make it if there is none. No other process may write it then.

    Raises:
        ConfigError: the file is no store of a campaign, cannot be opened, or another campaign is writing it.
    """

    def __init__(self, path: Path, *, write: bool = False) -> None:
        self.path: Final = path
        self._lock: int | None = None
        is_new = not path.exists() or path.stat().st_size == 0
        if is_new and not write:
            raise ConfigError("there is no such store of a campaign", source=str(path))
        try:
            self._sql: Final = sqlite3.connect(path, isolation_level=None)
        except sqlite3.Error as failure:
            raise self._cannot_be_opened(failure) from failure
        try:
            if write:
                self._lock_it()
            if is_new:
                self._sql.executescript(f"BEGIN;{_SCHEMA}COMMIT;")
                self._sql.execute(f"PRAGMA application_id = {_APPLICATION}")
                self._sql.execute(f"PRAGMA user_version = {VERSION}")
            kinds = [self._sql.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")]
        except (sqlite3.Error, OSError) as failure:
            self.close()
            raise self._cannot_be_opened(failure) from failure
        if kinds != [_APPLICATION, VERSION]:
            self.close()
            raise ConfigError("it is no store of a campaign, or one of another version", source=str(path))

    def _cannot_be_opened(self, failure: Exception) -> ConfigError:
        return ConfigError(f"it cannot be opened as a store of a campaign: {failure}", source=str(self.path))

    def _lock_it(self) -> None:
        # Unlike SQLite's own locks, this one lasts as long as the campaign, and ends with its process.
        self._lock = os.open(self.path, os.O_RDWR)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as failure:
            self.close()
            raise ConfigError("another campaign is writing it; wait for its end", source=str(self.path)) from failure

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write all changes of a block or none.

        Raises:
            RunFailed: the file cannot be written, because the disk is full, for example.
        """
        try:
            with self._sql:
                self._sql.execute("BEGIN")
                yield
        except sqlite3.Error as failure:
            raise RunFailed(f"'{self.path}' cannot be written: {failure}; finished runs are kept") from failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._sql.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    # --- what is run -----------------------------------------------------------------------------------------

    def about(self) -> dict[str, str]:
        """Return the description of the campaign: its `path`, `text`, `title`, `sources` and `versions`."""
        return dict(self._sql.execute("SELECT key, value FROM about"))

    def describe(self, about: Mapping[str, str]) -> None:
        """Store the description of the campaign, and count no run until `count` does.

        Raises:
            ConfigError: the stored runs were made of other sources.
        """
        before = self.about().get("sources", about["sources"])
        if before != about["sources"]:
            raise ConfigError(
                f"its runs were made of other sources ({before}; now {about['sources']}): the code, a mission or a "
                "library has changed since; name another file, or give --fresh to begin anew",
                source=str(self.path), key="--store",
            )  # fmt: skip
        with self._writing():
            self._sql.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", about.items())
            self._sql.execute("UPDATE runs SET counted = 0")

    def mark_whole(self) -> None:
        """Mark that all runs of the campaign are made."""
        with self._writing():
            self._sql.execute("INSERT OR REPLACE INTO about VALUES ('whole', 'yes')")

    def add(self, job: Job, done: Done) -> None:
        """Keep a finished run, which is on the disk when this returns."""
        result = done.result or {}
        hours = result["duration_s"] * result["robots"] / 3600.0 if result else None
        violations = result.get("violations")
        margins = [*(result.get("min_margin") or {}).values()]
        least = None if None in margins else min(margins, default=None)
        row = (
            job.id, job.part, job.number, 1, job.mission, job.seed, _json(job.axes), _json(job.settings), job.command,
            done.status, done.failure, done.trace, _json(done.findings), result.get("duration_s"),
            result.get("robots"), hours, None if violations is None else sum(violations.values()),
            result.get("contacts"), result.get("ac_share"), result.get("disengagements_total"),
            result.get("targets_reached"), result.get("longest_stall_s"), result.get("no_progress_s"),
            least, result.get("trace_sha256", ""), None if done.result is None else _json(result),
            _json(done.host), done.host.get("wall_s"),
        )  # fmt: skip
        with self._writing():
            self._sql.execute(f"INSERT OR REPLACE INTO runs VALUES ({', '.join('?' * len(row))})", row)  # noqa: S608

    def count(self, jobs: Iterable[Job]) -> None:
        """Count runs that the store already has."""
        numbers = [(job.number, job.id) for job in jobs]
        if numbers:
            with self._writing():
                self._sql.executemany("UPDATE runs SET counted = 1, number = ? WHERE id = ?", numbers)

    def leave_out(self, part: str, since: int) -> None:
        """Count no runs of a part from a number on, since the stopping rule held before them."""
        with self._writing():
            self._sql.execute("UPDATE runs SET counted = 0 WHERE part = ? AND number >= ?", (part, since))

    # --- what came out ---------------------------------------------------------------------------------------

    def ids(self) -> set[str]:
        """Return the ids of all finished runs, counted or not."""
        return {name for (name,) in self._sql.execute("SELECT id FROM runs")}

    def rows(self, *, part: str | None = None, run: str | None = None) -> Iterator[RunRow]:
        """Yield finished runs that count, in their order: all of them, or those of a part, or one by its id."""
        query = (
            f"SELECT {', '.join(_COLUMNS)} FROM runs WHERE (? IS NULL OR part = ?) "  # noqa: S608
            "AND (? IS NULL AND counted OR id = ?) ORDER BY part, number"
        )
        with closing(self._sql.execute(query, (part, part, run, run))) as found:
            for values in found:
                row = dict(zip(_COLUMNS, values, strict=True))
                row |= {name: json.loads(row[name] or "{}") for name in _JSON}
                yield RunRow(**{**row, "robot_hours": row["robot_hours"] or 0.0})


def _json(value: Any) -> str:
    return json.dumps(dict(value) if isinstance(value, Mapping) else value, sort_keys=True)
