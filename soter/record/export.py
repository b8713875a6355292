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
    """Write all messages of a recording into CSV files; return the written files.

    `ticks.csv` has a line a robot and tick, `modules.csv` one a module, robot and tick; the others one an event.
    Numbers are written so that reading them gives the same bits; absent values are empty cells.

    Raises:
        OSError: a file cannot be written.
        BadRecording: the recording is damaged; all messages before the damage have been written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    heads = [(*_TICK, *StateMessage.__struct_fields__, "ac_failure"), _MODULE]
    heads += [kind.__struct_fields__ for kind in EVENTS]
    with ExitStack() as stack:
        sheets: dict[str, Any] = {}
        for path, columns in zip(csv_files(folder), heads, strict=True):
            sheets[path.name] = csv.writer(stack.enter_context(path.open("w", newline="", encoding="utf-8")))
            sheets[path.name].writerow(columns)
        for _, message in recording.messages():
            if not isinstance(message, RobotTick):
                sheets[file_name(type(message))].writerow(_cells(message))
                continue
            head = (message.tick, message.time_s, message.robot_id)
            row = (*head, message.mode, message.driver, *_cells(message.state), message.ac_failure)
            sheets[TICKS_CSV].writerow(row)
            modules = ((*head, m.name, m.mode, m.margin_value, m.reach_value) for m in message.modules)
            sheets[MODULES_CSV].writerows(modules)
    return csv_files(folder)


def _cells(message: Struct) -> Iterator[object]:
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if value is UNSET:
            yield ""
        elif isinstance(value, tuple):
            yield " ".join(map(str, value))
        else:
            yield value
