"""docs/mission-file.md has every key of a mission file, and its default."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import fields

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from soter.config import MissionFile
from soter.config.promises import Promise
from soter.geometry.workspace_xml import parse_workspace
from soter.sdk import Capabilities
from tests.project.source import ROOT

PAGE = (ROOT / "docs" / "mission-file.md").read_text()
ROWS = dict(re.findall(r"^\| `([^`]+)` \| (.+?) \|", PAGE, re.MULTILINE))
# What is told in words, and elsewhere.
WORDS = {
    "workspace": "none",
    "robots.count": "all",
    "targets": '`"grid"`',
    "battery.initial": "drawn",
    "rta.modules": "all four",
}
ELSEWHERE = {"backends", "planners", "adversaries", "controllers", "fault", "distribution", "rta.module"}


def defaults(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Return every key that holds a value, and its default."""
    for name, field in model.model_fields.items():
        key = f"{prefix}{name}"
        if isinstance(field.default, BaseModel) and key not in ELSEWHERE:
            yield from defaults(type(field.default), f"{key}.")
        elif key not in ELSEWHERE:
            yield key, None if field.default is PydanticUndefined else field.default


def test_every_key_is_there_with_its_default() -> None:
    for key, default in defaults(MissionFile):
        shared = re.sub(r"^rta\.\w+\.(dwell_s|model)$", r"rta.MODULE.\1", key)
        said = ROWS.get(key, ROWS.get(shared))
        assert said is not None, key
        default = list(default) if isinstance(default, tuple) else default
        assert said == WORDS[key] if key in WORDS else json.loads(said.strip("`")) == default, key


def test_no_key_is_there_that_a_mission_does_not_have() -> None:
    keys = {key for key, _ in defaults(MissionFile)}
    assert {key for key in ROWS if "MODULE" not in key and "NAME" not in key} <= keys | {*Promise.model_fields}


def test_every_figure_that_may_be_promised_is_there_and_is_one() -> None:
    assert {*Promise.model_fields} <= {*ROWS}
    # What a backend is, and what an adapter finds out by itself, nobody promises in a file.
    found_out = {"in_process", "deterministic", "reports_battery", "reports_controller"}
    assert {*Promise.model_fields} == {field.name for field in fields(Capabilities)} - found_out


def test_its_workspace_is_one() -> None:
    found = re.search(r"```xml\n(.+?)```", PAGE, re.DOTALL)
    assert found is not None
    workspace = parse_workspace(found[1].encode(), "mission-file.md")
    assert (len(workspace.robots), len(workspace.boxes)) == (1, 1)
