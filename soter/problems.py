"""What is wrong with an input, gathered so that one error can name all of it, a line each."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from soter.errors import ConfigError, meant, nearest

MAX_FILE_BYTES = 1_000_000
"""No mission and no workspace is longer; what is was not meant for us and is not even read."""

MAX_NESTING = 20
TOO_DEEP = f"tables or lists are nested too deeply, allowed: at most {MAX_NESTING} levels"

_MAX_SHOWN = 20
_MAX_VALUE_CHARS = 60


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        message: what is wrong and what is allowed.
        key: the dotted key or the element, or empty.
        line: the line in the file, or None.
        source: where the value came from if not from the file, such as "command line".
    """

    message: str
    key: str = ""
    line: int | None = None
    source: str | None = None

    def error(self, source: str | None) -> ConfigError:
        """Return this problem as an error of its own; `source` is the file."""
        return ConfigError(self.message, source=self.source or source, line=self.line, key=self.key or None)


UNKNOWN_KEY: Final = "unknown key"
"""How messages about keys that nothing has begin."""


def config_error(problems: Sequence[Problem], source: str | None) -> ConfigError:
    """Return one error for all problems, in the order of their lines; `source` is the file.

    A single problem is raised as itself, with its line and key as attributes; several are listed, each with its
    own place, as compilers do it.
    """
    ordered = sorted(problems, key=lambda problem: (problem.line is None, problem.line or 0))
    if len(ordered) == 1:
        return ordered[0].error(source)
    shown = [str(problem.error(source)) for problem in ordered[:_MAX_SHOWN]]
    if len(ordered) > _MAX_SHOWN:
        shown.append(f"and {len(ordered) - _MAX_SHOWN} more")
    return ConfigError("\n  ".join([f"{len(ordered)} things are wrong", *shown]), source=source)


def shown_value(value: object) -> str:
    """Return a value as error messages show it, cut where it would fill the screen."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer with more digits than Python converts, or endless nesting
        text = "something huge"
    return cut(text)


def cut(text: str) -> str:
    """Return a text, without its tail if it is long."""
    return text if len(text) <= _MAX_VALUE_CHARS else f"{text[: _MAX_VALUE_CHARS - 3]}..."


def read_limited(path: Path, what: str, most_bytes: int = MAX_FILE_BYTES, *, shorter: str = "") -> bytes:
    """Read a small regular file as a whole.

    Args:
        path: the file.
        what: it should be, for messages, such as "mission file".
        most_bytes: the most that is read.
        shorter: what makes such a file shorter, for the message about one that is too long.

    Raises:
        ConfigError: there is no such file, it cannot be read, or it is longer than that.
    """
    source = str(path)
    try:
        # Only a regular file is opened: a pipe would block for ever, a device might never end.
        if not path.is_file():
            if path.is_dir():
                raise ConfigError(f"it is a folder; name a {what}", source=source)
            if path.exists():
                raise ConfigError(f"this {what} is a pipe or a device, allowed: a regular file", source=source)
            raise ConfigError(f"this {what} does not exist{meant(path)}", source=source)
        _refuse(_ENDINGS.get(path.suffix.lower()), what, source)
        with path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except (OSError, ValueError) as failure:
        raise ConfigError(f"this {what} cannot be read: {failure}", source=source) from failure
    if len(data) > most_bytes:
        advice = f"; {shorter}" if shorter else ""
        raise ConfigError(
            f"this {what} is longer than {most_bytes} bytes, the most that is read{advice}", source=source
        )
    return data


def is_file(path: Path) -> bool:
    """Whether there is a regular file; there is none whose name no system takes."""
    try:
        return path.is_file()
    except OSError:
        return False


_WORKSPACE = "workspace file"
_USES: Final = {
    "mission file": "`soter run {path}` runs it",
    "campaign file": "`soter campaign {path}` runs it",
    _WORKSPACE: "a mission file beside it names it, workspace = '{name}', and `soter workspace {path}` shows it",
    "script": "`soter run --mission {path}` runs it, and a mission file beside it may name it, mission = '{name}'",
    "recording": "`soter info`, `report` and `replay` read it",
}
"""What there is to do with a file, by what it is."""

_ENDINGS: Final = {
    ".py": "script",
    ".mcap": "recording",
    **dict.fromkeys((".xml", ".geojson", ".plan", ".kml", ".yaml", ".yml"), _WORKSPACE),
}
_KEYS: Final = {"workspace": "mission file", "part": "campaign file", "fence": _WORKSPACE}
"""What a TOML file is that has one of these keys; the first that it has counts."""


def _refuse(found: str | None, wanted: str, source: str) -> None:
    if found is not None and found != wanted and wanted in _USES:
        use = _USES[found].format(path=shlex.quote(source), name=Path(source).name)
        raise ConfigError(f"it is a {found}, allowed: a {wanted}; {use}", source=source)


_BARE = r"[A-Za-z0-9_-]+"
_KEY_PART = rf"""(?:{_BARE}|"[^"]*"|'[^']*')"""
_KEY = rf"{_KEY_PART}(?:[ \t]*\.[ \t]*{_KEY_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_KEY})\s*\]")
_PAIR = re.compile(rf"\s*({_KEY})[ \t]*=")
# Texts, of any kind, and comments; what is not closed reaches to its end, so that nothing is looked at twice.
_TEXT = re.compile(
    r'''"""(?:\\.|[^\\])*?(?:"{3,5}|\\?\Z)|'{3}.*?(?:'{3,5}|\Z)|"(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*''', re.DOTALL
)
_LONG_KEY = re.compile(rf"""(?<![A-Za-z0-9_-])(?:(?:{_BARE}|"")[ \t]*\.[ \t]*){{{MAX_NESTING},}}""")


def dotted(*parts: str) -> str:
    """Return a key as TOML has it: names that have dots of their own in quotes, long ones without their tails."""
    return ".".join(part if re.fullmatch(_BARE, part) else f'"{part}"' for part in map(cut, parts))


def split_key(key: str) -> tuple[str, ...]:
    """Split a dotted key as TOML does: dots inside quotes do not count."""
    return tuple(part.strip("\"'") for part in re.findall(rf"{_KEY_PART}|[^.\s]+", key))


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """Return the line of every table and key in the text of a TOML file, from 1.

    The tables of an array are told apart by their number, from 0: ("fault", "1") is the second `[[fault]]`.
    A line of a multi-line string that looks like a key is taken for one; what comes first wins, so this only ever
    misplaces an error message.
    """
    lines: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    counts: dict[tuple[str, ...], int] = {}
    # splitlines() would count form feeds and the like as well.
    for number, line in enumerate(text.split("\n"), start=1):
        if header := _HEADER.match(line):
            table = split_key(header[2])
            lines.setdefault(table, number)
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, str(counts[table]))
                lines.setdefault(table, number)
        elif pair := _PAIR.match(line):
            lines.setdefault(table + split_key(pair[1]), number)
    return lines


def parse_toml(data: bytes, source: str, what: str) -> tuple[dict[str, Any], dict[tuple[str, ...], int]]:
    """Return the tables in the bytes of a TOML file, and the lines of its keys; see `key_lines`.

    Args:
        data: the bytes.
        source: names the file in errors.
        what: it should be, such as "mission file".

    Raises:
        ConfigError: it is no TOML, which the error has the line of, or plainly a file of another kind.
    """
    try:
        # Some editors begin a file with a byte order mark, which TOML lets readers ignore.
        text = data.decode().removeprefix("\ufeff")
    except UnicodeDecodeError as failure:
        line = data[: failure.start].count(b"\n") + 1
        raise ConfigError("not UTF-8, as TOML must be; save it as UTF-8", source=source, line=line) from failure
    # Of a key with many parts the library makes tables in a time that grows with their square. Texts have dots, too.
    plain = _TEXT.sub(lambda found: '""' + "\n" * found[0].count("\n"), text)
    if long := _LONG_KEY.search(plain):
        raise ConfigError(TOO_DEEP, source=source, line=plain.count("\n", 0, long.start()) + 1)
    try:
        tables = tomllib.loads(text)
    except ValueError as failure:
        message, at = _syntax_error(str(failure))
        if at is not None and what == "mission file" and _second_mission(text, at):
            message += '; mission = "NAME" is short for [mission] with use = "NAME": write only the table'
        raise ConfigError(f"not valid TOML: {message}", source=source, line=at) from failure
    except RecursionError as failure:
        raise ConfigError(TOO_DEEP, source=source) from failure
    _refuse(next((kind for key, kind in _KEYS.items() if key in tables), None), what, source)
    return tables, key_lines(text)


def _syntax_error(message: str) -> tuple[str, int | None]:
    """Split what tomllib says into the message and the line; it has the line only in its text."""
    found = re.search(r" \(at line (\d+), column (\d+)\)$", message)
    if found is None:
        return message, None
    return f"{message[: found.start()]} (column {found[2]})", int(found[1])


def _second_mission(text: str, at: int) -> bool:
    """Return whether a line is about the mission, which a line above has as a value."""
    lines = text.split("\n")
    above = key_lines("\n".join(lines[: at - 1]))
    here = key_lines(lines[at - 1])
    return ("mission",) in above and any(key[0] == "mission" for key in here)


NOT_ALLOWED = "not_allowed"


def not_allowed(allowed: str) -> PydanticCustomError:
    """Return what a validator raises; `allowed` says what it would have taken."""
    return PydanticCustomError(NOT_ALLOWED, "allowed: {allowed}", {"allowed": allowed})


_ALLOWED = {
    "greater_than": "above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "below {lt}",
    "less_than_equal": "at most {le}",
    "finite_number": "a finite number",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text in quotes",
    "string_too_short": "a text that is not empty",
    "string_pattern_mismatch": "a text that matches {pattern}",
    "path_type": "a path in quotes",
    "dict_type": "a table",
    "model_type": "a table",
    "mapping_type": "a table",
    "list_type": "a list",
    "too_short": "at least {min_length} of them",
    "too_long": "at most {max_length} of them",
    "tuple_type": "a list",
}


def pydantic_problems(
    failure: ValidationError,
    model: type[BaseModel],
    *,
    prefix: tuple[str, ...] = (),
    lines: Mapping[tuple[str, ...], int] | None = None,
    elsewhere: Mapping[tuple[str, ...], str] | None = None,
    hidden: Collection[str] = (),
) -> list[Problem]:
    """Translate what pydantic found.

    Args:
        failure: its error.
        model: the model that refused; its fields are the valid names of unknown keys.
        prefix: the table that was validated.
        lines: from `key_lines`, or None for input without lines.
        elsewhere: keys that do not come from the file, and where they come from instead.
        hidden: fields of the model that are not for the user to give.
    """
    problems = []
    for error in failure.errors(include_url=False):
        inner = tuple(str(part) for part in error["loc"] if part != "[key]")
        where = prefix + inner
        origin = next((name for key, name in (elsewhere or {}).items() if key == where[: len(key)]), None)
        line = line_of(where, lines or {}) if origin is None else None
        message = _message(error, model, inner, hidden)
        if "[key]" in error["loc"]:
            message = f"of its name: {message}"
        problems.append(Problem(message, dotted(*where), line, origin))
    return problems


def _message(error: ErrorDetails, model: type[BaseModel], where: tuple[str, ...], hidden: Collection[str]) -> str:
    kind, context, value = error["type"], error.get("ctx", {}), shown_value(error["input"])
    if kind == "extra_forbidden":
        allowed = [name for name in _fields_at(model, where[:-1]) if name not in hidden]
        return f"{UNKNOWN_KEY}{nearest(where[-1], allowed)}; allowed: {', '.join(allowed) or 'none'}"
    if kind == "missing":
        return "it is missing, and has no default"
    if kind in ("literal_error", "enum"):
        expected = str(context["expected"])
        hint = nearest(error["input"], re.findall("'([^']*)'", expected)) if isinstance(error["input"], str) else ""
        return f"it is {value}, allowed: {expected}{hint}"
    if kind == NOT_ALLOWED:
        return f"it is {value}, allowed: {context['allowed']}"
    if kind == "model_type" and (fields := [name for name in _fields_at(model, where) if name not in hidden]):
        return f"it is {value}, allowed: a table of {', '.join(fields)}"
    if kind in _ALLOWED:
        # Limits of whole numbers are shown to the last digit.
        shown = {name: f"{limit:g}" if isinstance(limit, float) else limit for name, limit in context.items()}
        return f"it is {value}, allowed: {_ALLOWED[kind].format(**shown)}"
    if kind == "value_error":
        # Of a whole table the values stand in the file, beside what the program itself has filled in.
        return f"{context['error']}" if isinstance(error["input"], dict) else f"it is {value}: {context['error']}"
    return f"it is {value}: {error['msg'][:1].lower()}{error['msg'][1:]}"


def _fields_at(model: type[BaseModel], where: tuple[str, ...]) -> list[str]:
    """Return the names of the fields of the model that sits at a key."""
    parts = iter(where)
    for part in parts:
        field = model.model_fields.get(part)
        # A model whose other keys are tables says of what model.
        inner = getattr(model, "others", None) if field is None else field.annotation
        if (kind := get_origin(inner)) in (dict, list, tuple):
            # A table of tables with names of the user's own, or a list of them: the next part is a name, or a number.
            inner = get_args(inner)[kind is dict] if next(parts, None) is not None else None
        # A table that may be left out is one or None.
        models = [each for each in (inner, *get_args(inner)) if isinstance(each, type) and issubclass(each, BaseModel)]
        if not models:
            return []
        model = models[0]
    return list(model.model_fields)


def line_of(where: tuple[str, ...], lines: Mapping[tuple[str, ...], int]) -> int | None:
    """Return the line of a key, or of the nearest table around it that has one."""
    found = (lines.get(where[:length]) for length in range(len(where), 0, -1))
    return next((line for line in found if line is not None), None)
