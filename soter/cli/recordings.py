"""Where `soter run` records to, and what it says of it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Final

from soter.cli.exits import complain
from soter.errors import option_error

if TYPE_CHECKING:
    from rich.console import Console

    from soter.config import MissionFile
    from soter.record.recorder import RecordingReport

RUNS: Final = Path("runs")
"""The folder, below the present one, of recordings that were given no name."""

_MANY: Final = 1000


def recording_path(
    record: Path | None, no_record: bool, mission: MissionFile, process: str | None = None
) -> Path | None:
    """Return where to record a run, or one process of it, or None for nowhere.

    A recording that nobody asked for must not stop a run: where there is no place for it, that is said.

    Raises:
        ConfigError: the file that was asked for is another one already, or both options were given.
    """
    if record is not None:
        if no_record:
            raise option_error("--record", "it contradicts --no-record; give one of them")
        _refuse_other(record)
        return record
    if no_record or not _has_robots(mission, process):
        return None
    try:
        RUNS.mkdir(exist_ok=True)
        return _new_file(mission, process)
    except OSError as failure:
        complain(
            f"the run is not recorded: '{RUNS}' cannot be written ({failure.strerror}); give --record or --no-record"
        )
        return None


def _refuse_other(record: Path) -> None:
    """Refuse to replace a file that is no recording."""
    from soter.record.digest import MAGIC

    if record.is_file():
        with record.open("rb") as file:
            if file.read(len(MAGIC)) not in {b"", MAGIC}:
                raise option_error(
                    "--record",
                    f"'{record}' is there already, and is no recording; it is not replaced by one, nor with --force",
                )


@contextmanager
def unless_recorded(path: Path | None) -> Iterator[None]:
    """Take the file away again that was made for a run which then was refused."""
    try:
        yield
    finally:
        if path is not None:
            with suppress(OSError):
                if path.is_file() and path.stat().st_size == 0:
                    path.unlink()


def show_recording(console: Console, report: RecordingReport) -> None:
    """Say where the recording is, and what it lacks."""
    lacks = f", incomplete: {report.failure}" if report.failure else ""
    if report.dropped_ticks:
        lacks += f", {report.dropped_ticks} ticks dropped"
    if report.refused:
        lacks += f", {report.refused} messages of the mission's refused for their times"
    console.print(f"recording: {report.path} ({report.size_bytes / 1e6:.1f} MB{lacks})", soft_wrap=True)


def _has_robots(mission: MissionFile, process: str | None) -> bool:
    """Whether there is anything to record: not in a process with the task planner only."""
    table = mission.distribution.processes.get(process) if process is not None else None
    return table is None or bool(table.robots)


def _new_file(mission: MissionFile, process: str | None) -> Path:
    """Make a file that was not there, named after mission, process, backend and time."""
    # A backend may be named by its class.
    backend = re.sub(r"[^\w-]+", "-", mission.backend)
    # The time of day where the user sits: it is for finding one's own runs.
    now = datetime.now().astimezone()
    whole = PurePath(mission.source or "mission").stem
    part = whole if process is None else f"{whole}-{process}"
    name = f"{part}-{backend}-{now:%Y%m%d-%H%M%S}"
    for number in range(1, _MANY):
        path = RUNS / (f"{name}.mcap" if number == 1 else f"{name}-{number}.mcap")
        try:
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        except FileExistsError:
            continue
        return path
    raise FileExistsError(f"{_MANY} recordings of this second")
