"""The text of mission files that commands write."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from soter.config import MissionFile
from soter.config.toml_text import toml
from soter.loading import file_of


def mission_text(mission: MissionFile, changes: Mapping[str, Any], target: Path, head: str) -> str:
    """Return a mission as the text of another file, with all paths relative to that file.

    `changes` are tables that replace the mission's own, and `head` is a first line with the text's origin.
    """

    def seen(path: Path) -> str:
        return os.path.relpath(path.resolve(), target.resolve().parent)

    tables = {**mission.model_dump(mode="json", exclude_unset=True, exclude_none=True), **changes}
    tables["workspace"] = seen(mission.workspace)
    own = tables.get("rta", {}).get("module", {}).values()
    for table, key in ((tables, "ac"), (tables.get("mission", {}), "use"), *((each, "declare") for each in own)):
        if (file := file_of(table.get(key, ""))) is not None:
            table[key] = table[key].replace(str(file), seen(file), 1)
    return f"# {head}\n\n{toml(tables)}"
