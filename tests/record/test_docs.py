"""docs/recording.md has what the schemas have, word for word. Run this file to get the tables for it."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from soter.record import foxglove, messages
from soter.record.file import json_schema
from soter.record.messages import EVENTS, HeardMessage, ModuleTick, Refusal, RobotTick, StateMessage, WorstMessage
from tests.project.source import ROOT

KINDS: tuple[type[msgspec.Struct], ...] = (
    RobotTick,
    StateMessage,
    ModuleTick,
    Refusal,
    *EVENTS,
    HeardMessage,
    WorstMessage,
)
PAGE = ROOT / "docs" / "recording.md"


def table(kind: type[msgspec.Struct]) -> str:
    """A schema as a table."""
    schema = json_schema(kind)
    needed = schema.get("required", ())
    lines = ["| field | type | |", "|---|---|---|"]
    for name, field in schema["properties"].items():
        mark = "" if name in needed else "?"
        lines.append(f"| `{name}`{mark} | {_kind(field)} | {field.get('description', '')} |")
    return "\n".join(lines)


def heading(kind: type[msgspec.Struct]) -> str:
    """What stands above it."""
    topic = messages.TOPICS.get(kind) if issubclass(kind, messages.Message) else None
    where = f" on `{topic}`" if topic else ""
    return f"### `{messages.schema_name(kind)}`{where}\n\n{json_schema(kind)['description']}"


def _kind(field: dict[str, Any]) -> str:
    if "$ref" in field:
        return f"`{field['$ref'].rpartition('/')[2].removesuffix('Message')}`"
    if field["type"] == "array":
        return f"list of {_kind(field['items'])}"
    return str(field["type"])


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_has_every_schema(kind: type[msgspec.Struct]) -> None:
    assert f"{heading(kind)}\n\n{table(kind)}\n" in PAGE.read_text()


def test_the_page_names_every_topic_that_is_drawn() -> None:
    page = PAGE.read_text()
    for kind, topics in foxglove.TOPICS.items():
        assert f"`{messages.schema_name(kind)}`" in page
        for topic in topics:
            assert f"`{topic}`" in page


if __name__ == "__main__":
    print("\n\n".join(f"{heading(kind)}\n\n{table(kind)}" for kind in KINDS))
