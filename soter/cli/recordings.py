"""The recording of `soter run`: its file, and the message about it."""

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
"""The folder, below the working directory, of recordings without a given name."""

_MANY: Final = 1000


def recording_path(
    record: Path | None, no_record: bool, mission: MissionFile, process: str | None = None
) -> Path | None:
    """Return the file to record a run, or one process of it, in; None for no recording.

    A recording that was not requested must not stop a run: if it cannot be written, a message says so.

    Raises:
        ConfigError: the requested file exists and is no recording, or both options were given.
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
    """Remove the file that was made for a run if the run is refused."""
    try:
        yield
    finally:
        if path is not None:
            with suppress(OSError):
                if path.is_file() and path.stat().st_size == 0:
                    path.unlink()


def show_recording(console: Console, report: RecordingReport) -> None:
    """Print the path of the recording, and what it lacks; or why there is none."""
    if report.failure and not report.size_bytes:
        console.print(f"no recording: {report.failure}", soft_wrap=True)
        return
    lacks = f", incomplete: {report.failure}" if report.failure else ""
    if report.dropped_ticks:
        lacks += f", {report.dropped_ticks} ticks dropped"
    if report.refused:
        lacks += f", {report.refused} messages of the mission's refused for their times"
    console.print(f"recording: {report.path} ({report.size_bytes / 1e6:.1f} MB{lacks})", soft_wrap=True)


def _has_robots(mission: MissionFile, process: str | None) -> bool:
    """Return whether this process has robots to record; one with the task planner only has none."""
    table = mission.distribution.processes.get(process) if process is not None else None
    return table is None or bool(table.robots)


def _new_file(mission: MissionFile, process: str | None) -> Path:
    """Make a new file, named after mission, process, backend and time."""
    # The name of a backend may be that of a class.
    backend = re.sub(r"[^\w-]+", "-", mission.backend)
    # Local time, so that users find their own runs.
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
