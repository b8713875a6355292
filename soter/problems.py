"""What is wrong with an input, gathered so that one error can name all of it, a line each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from soter.errors import ConfigError, nearest

MAX_FILE_BYTES = 1_000_000
"""No mission and no workspace is longer; what is was not meant for us and is not even read."""

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
    except ValueError:  # an integer with more digits than Python converts
        text = "a huge number"
    return text if len(text) <= _MAX_VALUE_CHARS else f"{text[: _MAX_VALUE_CHARS - 3]}..."


def read_limited(path: Path, what: str) -> bytes:
    """Read a small regular file as a whole.

    Args:
        path: the file.
        what: what it should be, for the message, such as "mission file".

    Raises:
        ConfigError: there is no such file, it cannot be read, or it is longer than `MAX_FILE_BYTES`.
    """
    source = str(path)
    try:
        # Only a regular file is opened: a pipe would block for ever, a device might never end.
        if not path.is_file():
            found = "is not a file" if path.exists() else "does not exist"
            raise ConfigError(f"this {what} {found}{nearest(path.name, _beside(path))}", source=source)
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as failure:
        raise ConfigError(f"this {what} cannot be read: {failure}", source=source) from failure
    if len(data) > MAX_FILE_BYTES:
        raise ConfigError(f"this {what} is longer than {MAX_FILE_BYTES} bytes, the most that is read", source=source)
    return data


def _beside(path: Path) -> list[str]:
    """Return the names of the files that may have been meant, sorted."""
    try:
        return sorted(other.name for other in path.parent.iterdir() if other.suffix == path.suffix)
    except OSError:
        return []
