"""Checks raw tables of a mission file with the models of the classes that they are for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

from pydantic import BaseModel, ValidationError

from soter.errors import ConfigError, account_of, nearest
from soter.problems import (
    UNKNOWN_KEY,
    Problem,
    config_error,
    dotted,
    key_lines,
    line_of,
    pydantic_problems,
    read_limited,
    shown_value,
    split_key,
)

COMMAND_LINE: Final = "command line"

Options = TypeVar("Options", bound=BaseModel)


def validate_options(
    model: type[Options],
    raw: Mapping[str, object],
    source: str | None,
    key: str,
    filled: Mapping[str, object] | None = None,
    overridden: Mapping[tuple[str, ...], str] = MappingProxyType({}),
) -> Options:
    """Check a raw table of options with the model of the class that it is for.

    Args:
        model: the class's own model.
        raw: the table, such as `mission.backends.get("pybullet", {})`.
        source: the mission file, or None.
        key: the table's dotted key, such as "backends.pybullet".
        filled: options that the program itself sets, which the table may not have.
        overridden: the mission's `overridden`, for errors about values that are not from the file.

    Raises:
        ConfigError: an option is unknown or not allowed; all problems are listed.
    """
    filled = filled or {}
    prefix = split_key(key)
    lines = _lines_in(source)
    allowed = [name for name in model.model_fields if name not in filled]
    problems = [
        Problem(
            f"{UNKNOWN_KEY}{nearest(name, allowed)}; allowed: {', '.join(allowed) or 'none'}",
            f"{key}.{name}",
            lines.get((*prefix, name)),
        )
        for name in raw
        if name in filled
    ]
    try:
        options = model.model_validate({**raw, **filled})
    except ValidationError as failure:
        problems += pydantic_problems(failure, model, prefix=prefix, lines=lines, elsewhere=overridden, hidden=filled)
        raise config_error(problems, source) from failure
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code may check them
        raise ConfigError(
            f"these options cannot be checked: {account_of(failure)}", source=source, key=key
        ) from failure
    for where, message in _unnoticed(options, raw):
        at = (*prefix, *where)
        own = next((origin for each, origin in overridden.items() if each == at[: len(each)]), None)
        problems.append(Problem(message, dotted(*at), None if own else line_of(at, lines), own))
    if problems:
        raise config_error(problems, source)
    return options


def _unnoticed(value: object, raw: object, at: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the keys with slips that a model took no notice of, as pydantic's do unless told otherwise, in words.

    These are unknown keys, and texts and numbers in place of true or false. A model that says itself what becomes of
    unknown keys, by `extra`, is left to that.
    """
    if isinstance(value, bool) and not isinstance(raw, bool):
        yield at, f"it is {shown_value(raw)}, allowed: true or false"
    elif isinstance(value, BaseModel) and isinstance(raw, Mapping):
        config, fields = type(value).model_config, type(value).model_fields
        known = {field.alias or name: name for name, field in fields.items()}
        if config.get("populate_by_name") or config.get("validate_by_name"):
            known |= {name: name for name in fields}
        if "extra" not in config:
            unknown = [key for key in raw if key not in known]
            yield from (
                ((*at, key), f"{UNKNOWN_KEY}{nearest(key, [*known])}; allowed: {', '.join(known)}") for key in unknown
            )
        for key in known.keys() & raw.keys():
            yield from _unnoticed(getattr(value, known[key]), raw[key], (*at, key))
    elif isinstance(value, Mapping) and isinstance(raw, Mapping) and len(value) == len(raw):
        for each, (key, of) in zip(value.values(), raw.items(), strict=True):
            yield from _unnoticed(each, of, (*at, key))
    elif isinstance(value, list | tuple) and isinstance(raw, list) and len(value) == len(raw):
        for index, (each, of) in enumerate(zip(value, raw, strict=True)):
            yield from _unnoticed(each, of, (*at, str(index)))


def _lines_in(source: str | None) -> dict[tuple[str, ...], int]:
    """Return the lines of the keys of a mission file; empty if the file cannot be read again."""
    try:
        return key_lines(read_limited(Path(source), "mission file").decode()) if source else {}
    except (ConfigError, UnicodeDecodeError):
        return {}
