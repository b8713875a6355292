"""Reads mission files, with values that replace theirs, and says of each problem where it is."""

from __future__ import annotations

import ast
import copy
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from soter.config.mission_file import MissionFile
from soter.config.options import COMMAND_LINE
from soter.config.tables import SURVEILLANCE
from soter.errors import ConfigError
from soter.loading import file_of, seen_from
from soter.problems import (
    MAX_NESTING,
    TOO_DEEP,
    Problem,
    config_error,
    dotted,
    line_of,
    parse_toml,
    pydantic_problems,
    read_limited,
    split_key,
)

UNKNOWN: Final = ("extra_forbidden", 1)
"""What pydantic says of an unknown key, and how deep one of the first level is."""


def load_mission(
    path: Path | str,
    overrides: Mapping[str, object] | None = None,
    engine: str | None = None,
    origins: Mapping[str, str] | None = None,
) -> MissionFile:
    """Read a mission file.

    Args:
        path: the TOML file.
        overrides: values that replace the file's, by dotted key such as "rta.collision.delta_s"; None as a value means
            not given.
        engine: value for the option `engine` of the mission's backend; None to keep the file's.
        origins: where overrides come from, for messages, by key; the command line, if not given.

    Raises:
        ConfigError: the file cannot be read, or something in it is not allowed; all problems are listed, with line,
            dotted key, value and what is allowed.
    """
    path = Path(path)
    data = read_limited(path, "mission file")
    mission = parse_mission(data, str(path), overrides, origins)
    if engine is not None:
        # A backend may be named by its class, which contains dots.
        both = {**(overrides or {}), f'backends."{mission.backend}".engine': engine}
        return load_mission(path, both, origins=origins)
    changes: dict[str, Any] = {"workspace": path.parent / mission.workspace}
    if file_of(mission.mission.use) is not None:
        changes["mission"] = mission.mission.model_copy(update={"use": seen_from(path.parent, mission.mission.use)})
    if file_of(mission.ac) is not None:
        changes["ac"] = seen_from(path.parent, mission.ac)
    own = {
        name: table.model_copy(update={"declare": seen_from(path.parent, table.declare)})
        for name, table in mission.rta.module.items()
        if file_of(table.declare) is not None
    }
    if own:
        changes["rta"] = mission.rta.model_copy(update={"module": {**mission.rta.module, **own}})
    return mission.model_copy(update=changes)


def parse_mission(
    data: bytes,
    source: str,
    overrides: Mapping[str, object] | None = None,
    origins: Mapping[str, str] | None = None,
) -> MissionFile:
    """Read a mission from the bytes of a TOML file; `source` names it in errors. See `load_mission`."""
    raw, lines = parse_toml(data, source, "mission file")
    return _checked(raw, source, overrides, lines, origins or {})


def make_mission(tables: Mapping[str, Any], source: str, overrides: Mapping[str, object] | None = None) -> MissionFile:
    """Make a mission from its tables, such as a recording's; `source` names them in errors. See `load_mission`."""
    return _checked(copy.deepcopy(dict(tables)), source, overrides, {}, {})


def _checked(
    raw: dict[str, Any],
    source: str,
    overrides: Mapping[str, object] | None,
    lines: dict[tuple[str, ...], int],
    origins: Mapping[str, str],
) -> MissionFile:
    where = {split_key(key): origins.get(key, COMMAND_LINE) for key in overrides or {}}
    given = {split_key(key): value for key, value in (overrides or {}).items() if value is not None}
    of_single = isinstance(raw.get("robots"), dict) or any(key[:1] == ("robots",) and len(key) > 1 for key in given)
    if of_single and isinstance(raw.get("robots"), int):
        # The number may stand alone in the file, and promises of single robots be given beside it.
        raw["robots"] = {"count": raw["robots"]}
    if of_single and isinstance(given.get(("robots",)), int):
        # Overriding the number of robots keeps the tables of single robots.
        if ("robots", "count") in given:
            raise ConfigError("it is given twice, also as robots.count", source=where["robots",], key="robots")
        given["robots", "count"] = given.pop(("robots",))
        where["robots", "count"] = where["robots",]
    if raw.get("app") == SURVEILLANCE and "mission" not in raw:
        # Older files and recordings, from before missions had names, have this key.
        del raw["app"]
    _name_in_table(raw)
    if ("mission",) in given:
        # It is short for an option of the mission that the file names, which is replaced.
        raw.pop("targets", None)
    for key, value in sorted(given.items(), key=lambda each: each[0]):
        _override(raw, key, copy.deepcopy(value), where[key])
        _name_in_table(raw)
    _refuse_what_no_key_has(raw, source, lines)
    try:
        mission = MissionFile.model_validate(raw)
    except ValidationError as failure:
        elsewhere = {key: where[key] for key in given}
        # A table that only an override names, such as a misspelt one, is reported as a whole.
        in_file = {line[:end] for line in lines for end in range(1, len(line) + 1)}
        for key in given:
            elsewhere |= {key[:end]: where[key] for end in range(1, len(key)) if lines and key[:end] not in in_file}
        problems = pydantic_problems(failure, MissionFile, lines=lines, elsewhere=elsewhere)
        unknown = {str(each["loc"][0]) for each in failure.errors() if (each["type"], len(each["loc"])) == UNKNOWN}
        problems = [_misplaced_option(each, raw, source) if each.key in unknown else each for each in problems]
        raise config_error(problems, source) from failure
    return mission.read_from(source, lines, {key: where[key] for key in given})


def _misplaced_option(problem: Problem, raw: Mapping[str, Any], source: str) -> Problem:
    """Return the problem of an unknown key, and say of an option of the mission's own where it belongs."""
    table = raw.get("mission")
    use = table.get("use", SURVEILLANCE) if isinstance(table, dict) else SURVEILLANCE
    if not isinstance(use, str) or use == SURVEILLANCE:
        return problem
    if file_of(use) is None:
        return replace(problem, message=f"{problem.message}; options of mission '{use}' belong under [mission]")
    if problem.key not in _options_in(file_of(seen_from(Path(source).parent, use))):
        return problem
    message = f"it is an option of the mission, and belongs under [mission], beside use = '{use}'"
    return replace(problem, message=message)


def _options_in(file: Path | None) -> set[str]:
    """Return the names of the options that missions in a file have, without running it; empty if it cannot be read."""
    try:
        tree = ast.parse(read_limited(file, "file")) if file else ast.Module([], [])
    except (ConfigError, SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    return {
        field.target.id
        for each in ast.walk(tree)
        if isinstance(each, ast.ClassDef) and each.name == "Options"
        for field in each.body
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
    }


def _refuse_what_no_key_has(raw: Mapping[str, Any], source: str, lines: dict[tuple[str, ...], int]) -> None:
    """Refuse NULs, and more levels than a mission can use (dotted keys nest deeper than tomllib itself recurses)."""
    level: list[tuple[tuple[str, ...], object]] = [((), raw)]
    for _ in range(MAX_NESTING):
        for key, value in level:
            if any("\0" in text for text in (*key, value if isinstance(value, str) else "")):
                message = "it has the character U+0000, allowed: what a file can be called"
                raise ConfigError(message, source=source, line=line_of(key, lines), key=dotted(*key))
        level = [
            ((*key, str(name)), inner)
            for key, value in level
            for name, inner in (
                value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
            )
        ]
        if not level:
            return
    raise ConfigError(TOO_DEEP, source=source)


def _name_in_table(raw: dict[str, Any]) -> None:
    """Turn a mission given by name only into a table, so that it can have options."""
    if isinstance(raw.get("mission"), str):
        raw["mission"] = {"use": raw["mission"]}


def _override(raw: dict[str, Any], key: tuple[str, ...], value: object, origin: str) -> None:
    table: object = raw
    for part in key[:-1]:
        table = table.setdefault(part, {}) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not key:
        raise ConfigError("there is no such key: its parent is not a table", source=origin, key=dotted(*key) or "''")
    table[key[-1]] = value
