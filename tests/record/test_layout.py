"""The layout for the Foxglove app shows what recordings have."""

from __future__ import annotations

import json
import re
from typing import Any, get_args

import msgspec

from soter.config.tables import MODULES
from soter.record.file import channels
from tests.project.source import ROOT

LAYOUT = json.loads((ROOT / "examples" / "foxglove-layout.json").read_text(encoding="utf-8"))


def values(found: Any) -> list[str]:
    """Every text and name in it."""
    if isinstance(found, dict):
        return [*found, *(text for each in found.values() for text in values(each))]
    if isinstance(found, list):
        return [text for each in found for text in values(each)]
    return [found] if isinstance(found, str) else []


def struct_in(kind: Any) -> Any:
    """The kind of message that a list, or a field that may be left out, holds."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind
    return next((found for each in get_args(kind) if (found := struct_in(each)) is not None), None)


def test_every_topic_and_field_is_one_of_a_recording() -> None:
    topics = channels([1, 2])
    named = [text for text in values(LAYOUT["configById"]) if text.startswith("/")]
    assert len(named) > 15
    for text in named:
        topic, _, path = text.partition(".")
        assert topic in topics, text
        kind: Any = topics[topic]
        for part in path.split(".") if path else ():
            found = re.fullmatch(r'(\w+)(\[:\]\{name=="(\w+)"\})?', part)
            assert found is not None, text
            fields = {field.name: field.type for field in msgspec.structs.fields(kind)}
            assert found[1] in fields, text
            assert found[3] is None or found[3] in MODULES, text
            kind = struct_in(fields[found[1]]) if found[2] else fields[found[1]]


def test_every_panel_is_laid_out_once() -> None:
    def panels(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*panels(node["first"]), *panels(node["second"])]

    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
