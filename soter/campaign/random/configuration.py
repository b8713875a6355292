"""A configuration: the tables of a mission file and the room that it names; written to and read from a folder."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from soter.campaign.random.room import DrawnRoom
from soter.config.toml_text import toml

MISSION_FILE: Final = "mission.toml"

Tables = dict[str, Any]


@dataclass(frozen=True)
class Configuration:
    """The input of one run.

    Attributes:
        tables: the mission file, without `workspace`.
        room: the workspace file.
    """

    tables: Tables
    room: DrawnRoom

    def write(self, folder: Path, note: str = "") -> Path:
        """Write both files into a folder, which is created; return the mission file, with a note at its top."""
        folder.mkdir(parents=True, exist_ok=True)
        workspace = self.room.write(folder)
        mission = folder / MISSION_FILE
        comment = "".join(f"# {line}\n" for line in note.splitlines())
        mission.write_text(comment + toml({"workspace": workspace, **self.tables}), encoding="utf-8")
        return mission

    @classmethod
    def read(cls, mission: Path) -> Configuration:
        """Read a mission file and the workspace that it names."""
        tables = tomllib.loads(mission.read_text(encoding="utf-8"))
        return cls(tables, DrawnRoom.read(mission.parent / tables.pop("workspace")))
