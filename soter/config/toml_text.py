"""Writes tables as TOML, which the standard library can only read."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any


def toml(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML: plain values first, then tables, then lists of tables, in the order given.

    Raises:
        ValueError: a number is not finite.
        TypeError: a value has a type that JSON does not have.
    """
    return "\n".join(_lines(tables, ())) + "\n"


def _lines(tables: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    inner = {key: value for key, value in tables.items() if isinstance(value, Mapping) or _is_tables(value)}
    for key, value in tables.items():
        if key not in inner:
            yield f"{toml_key(key)} = {inline(value)}"
    for key, value in inner.items():
        here = (*path, key)
        name = ".".join(map(toml_key, here))
        if isinstance(value, Mapping):
            if not value or any(not isinstance(each, Mapping) for each in value.values()):
                yield f"\n[{name}]"
            yield from _lines(value, here)
        else:
            for table in value:
                yield f"\n[[{name}]]"
                yield from _lines(table, here)


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)


def toml_key(key: str) -> str:
    """Return a key as TOML has it: in quotes unless it is made of letters, digits, - and _."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def inline(value: object) -> str:
    """Return a value as TOML, as after an equals sign; it raises what `toml` raises."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{toml_key(key)} = {inline(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(inline, value))}]"
    # JSON's bools and finite numbers are valid TOML.
    return _text(value) if isinstance(value, str) else json.dumps(value, allow_nan=False)


def _text(text: str) -> str:
    # So are its strings, except surrogate pairs and DEL, the one control character that JSON does not escape.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
