"""Writes a recording as CSV files, for spreadsheets and data frames: one file a kind of message."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from msgspec import UNSET, Struct

from soter.record.messages import EVENTS, RobotTick, StateMessage, kind_name
from soter.record.reader import Recording

TICKS_CSV: Final = "ticks.csv"
MODULES_CSV: Final = "modules.csv"

_TICK: Final = ("tick", "time_s", "robot_id", "mode", "driver")
_MODULE: Final = ("tick", "time_s", "robot_id", "module", "mode", "margin", "reach")


def file_name(event: type[Struct]) -> str:
    """Return the name of the file that a kind of event goes into, such as `switch.csv`."""
    return f"{kind_name(event).lower()}.csv"


def csv_files(folder: Path) -> list[Path]:
    """Return the files that `export_csv` writes into a folder."""
    return [folder / name for name in (TICKS_CSV, MODULES_CSV, *map(file_name, EVENTS))]


def export_csv(recording: Recording, folder: Path) -> list[Path]:
    """Write all messages of a recording into CSV files; return those that were written.

    `ticks.csv` has a line a robot and tick, `modules.csv` one a module, robot and tick; the others one an event.
    Numbers are written so that reading them gives the same bits; what is absent is an empty cell.

    Raises:
        OSError: it cannot be written.
        BadRecording: it is damaged; what was read until then has been written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        sheets = _Sheets(folder, stack)
        ticks = sheets.sheet(TICKS_CSV, (*_TICK, *StateMessage.__struct_fields__, "ac_failure"))
        modules = sheets.sheet(MODULES_CSV, _MODULE)
        for kind in EVENTS:
            sheets.sheet(file_name(kind), kind.__struct_fields__)
        for _, message in recording.messages():
            if not isinstance(message, RobotTick):
                sheets.sheet(file_name(type(message)), ()).writerow(_cells(message))
                continue
            head = (message.tick, message.time_s, message.robot_id)
            ticks.writerow((*head, message.mode, message.driver, *_cells(message.state), message.ac_failure))
            modules.writerows((*head, m.name, m.mode, m.margin_value, m.reach_value) for m in message.modules)
    return sheets.paths


class _Sheets:
    """Open CSV files, by name."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder: Final = folder
        self._stack: Final = stack
        self._writers: Final[dict[str, Any]] = {}
        self.paths: Final[list[Path]] = []

    def sheet(self, name: str, columns: tuple[str, ...]) -> Any:
        writer = self._writers.get(name)
        if writer is None:
            path = self._folder / name
            writer = csv.writer(self._stack.enter_context(path.open("w", newline="", encoding="utf-8")))
            writer.writerow(columns)
            self._writers[name] = writer
            self.paths.append(path)
        return writer


def _cells(message: Struct) -> Iterator[object]:
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if value is UNSET:
            yield ""
        elif isinstance(value, tuple):
            yield " ".join(map(str, value))
        else:
            yield value
