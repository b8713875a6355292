"""Common parts of programs that open a session: its command-line options, and error messages."""

from __future__ import annotations

import argparse
import json
import math
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from soter.adapters.zenoh.session import SessionOptions
from soter.config import validate_options
from soter.errors import ConfigError, SoterError
from soter.problems import read_limited


def positive(text: str) -> float:
    """Return the number above 0 in a text, for an option of a parser.

    Raises:
        argparse.ArgumentTypeError: the text is no such number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"it is {text}, allowed: finite and above 0")
    return value


def add_session(parser: argparse.ArgumentParser) -> None:
    """Add the options of a session to a parser."""
    parser.add_argument(
        "--session", type=Path, metavar="FILE",
        help="how Zenoh is reached: the keys of [backends.zenoh.session], as TOML or, in a file.json, as JSON",
    )  # fmt: skip
    parser.add_argument("--mode", metavar="M", help="what the session is: peer, which is the default, or client")
    parser.add_argument("--listen", action="append", metavar="E", help="where it listens, such as tcp/127.0.0.1:7447")
    parser.add_argument("--connect", action="append", metavar="E", help="where it connects to; may be repeated")


def read_session(given: argparse.Namespace) -> SessionOptions:
    """Return the session options from the command line, see `add_session`.

    Raises:
        ConfigError: an option is not allowed; the message lists all that is wrong.
    """
    return session_options(given.session, mode=given.mode, listen=given.listen, connect=given.connect)


def session_options(file: Path | None, **told: object) -> SessionOptions:
    """Return the options of a session.

    Args:
        file: a file with options, or None.
        told: options that replace those of the file; None does not replace.

    Raises:
        ConfigError: an option is not allowed; the message lists all that is wrong.
    """
    raw = {} if file is None else _read(file)
    raw |= {name: value for name, value in told.items() if value is not None}
    return validate_options(SessionOptions, raw, "command line" if file is None else str(file), "session")


def _read(file: Path) -> dict[str, object]:
    source = str(file)
    try:
        text = read_limited(file, "session file").decode("utf-8")
        raw = json.loads(text) if file.suffix == ".json" else tomllib.loads(text)
    except ValueError as failure:
        raise ConfigError(f"it cannot be read: {failure}", source=source) from failure
    if not isinstance(raw, dict):
        raise ConfigError("this is no table", source=source)
    return raw


@contextmanager
def refusing(parser: argparse.ArgumentParser) -> Iterator[None]:
    """End a program with an error message and code 2 at a `SoterError`."""
    try:
        yield
    except SoterError as failure:
        parser.exit(2, f"{parser.prog}: error: {failure}\n")
