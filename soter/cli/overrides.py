"""Options of the command line as overrides of a mission file's keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.complete import backends, missions, recordings
from soter.cli.option import option
from soter.errors import option_error

if TYPE_CHECKING:
    from soter.config import MissionFile

MissionArgument = Annotated[
    Path,
    typer.Argument(metavar="MISSION", help="The mission file (TOML).", show_default=False, autocompletion=missions),
]
MaybeMission = Annotated[
    Path | None,
    typer.Argument(
        metavar="MISSION", help="The mission file (TOML); a room of 5 m with two robots without one.",
        autocompletion=missions,
    ),
]  # fmt: skip
Promising = Annotated[
    str | None,
    option("NAME", "Whose robots' declared capabilities; none is opened.", "--backend", autocompletion=backends),
]
OtherBackend = Annotated[
    str | None, option("NAME", "Another backend than the mission file's.", "--backend", autocompletion=backends)
]
RecordingArgument = Annotated[
    Path,
    typer.Argument(metavar="FILE.mcap", help="The recording.", show_default=False, autocompletion=recordings),
]
Settings = Annotated[
    list[str] | None,
    option("KEY=VALUE", "Override any key of the mission file; may be repeated.", "--set"),
]


def module_list(text: str) -> list[str]:
    """Split the value of `--modules`.

    Raises:
        ConfigError: the value names no module.
    """
    names = [name for part in text.split(",") if (name := part.strip())]
    if not names:
        raise option_error("--modules", "it names no module; write them as a,b, or remove all of them with --no-rta")
    return names


def parse_setting(setting: str) -> tuple[str, object]:
    """Split one `--set key=value`. The value is read as TOML, or else taken as a text.

    Raises:
        ConfigError: the setting is not of that form.
    """
    key, equals, text = setting.partition("=")
    key, text = key.strip(), text.strip()
    if not equals or not key or not text:
        raise option_error("--set", f"'{setting}' is not of the form key=value, such as rta.geofence.delta_s=0.25")
    import tomllib

    try:
        found = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return key, text
    # A line break in the value could add more keys.
    return key, found["value"] if len(found) == 1 else text


def from_here(name: str | None) -> str | None:
    """Return a name from the command line; a file in it is relative to the working directory, not the mission file."""
    from soter.loading import seen_from

    return None if name is None else seen_from(Path.cwd(), name)


def merge(options: Mapping[str, object], settings: Sequence[str] | None) -> dict[str, object]:
    """Return the overrides by options, given by dotted key (None if not given), and by `--set`.

    Raises:
        ConfigError: a setting is malformed, or a key is given twice.
    """
    merged = {key: value for key, value in options.items() if value is not None}
    for setting in settings or ():
        key, value = parse_setting(setting)
        if key in merged:
            raise option_error(key, "it is given twice")
        merged[key] = value
    return merged


def load_with_engine(path: Path, overrides: Mapping[str, object], engine: str | None = None) -> MissionFile:
    """Read a mission; `engine` becomes an option of the mission's backend, after the overrides.

    Raises:
        ConfigError: the file or an override is not allowed.
    """
    from soter.config import load_mission
    from soter.loading import find_from_here

    find_from_here()
    return load_mission(path, overrides, engine)
