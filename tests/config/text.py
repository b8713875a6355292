"""Mission files as text, and what is said of those that are wrong."""

from __future__ import annotations

import pytest

from soter.config import MissionFile, parse_mission
from soter.errors import ConfigError

HEAD = 'workspace = "room.xml"\n'
CHEAP = (
    "m.toml:3: battery.idle_s: it is 1799.0, allowed: at least drive_s, which is 1800: standing still costs no more "
    "than driving"
)


def mission(text: str = "", overrides: dict[str, object] | None = None) -> MissionFile:
    return parse_mission((HEAD + text).encode(), "m.toml", overrides)


def error(text: str, overrides: dict[str, object] | None = None) -> str:
    with pytest.raises(ConfigError) as caught:
        mission(text, overrides)
    return str(caught.value)
