"""What programs that open a session have in common: what they are told about it, and how they refuse."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from soter.adapters.zenoh.session import SessionOptions
from soter.config import validate_options
from soter.errors import ConfigError, SoterError

_COMMAND_LINE = "command line"


def add_session(parser: argparse.ArgumentParser) -> None:
    """Let a program be told how to open its session."""
    parser.add_argument(
        "--session", type=Path, metavar="FILE",
        help="how Zenoh is reached, as JSON with the keys of [backends.zenoh.session]",
    )  # fmt: skip
    parser.add_argument("--mode", metavar="M", help="what the session is: peer, which is the default, or client")
    parser.add_argument("--listen", action="append", metavar="E", help="where it listens, such as tcp/127.0.0.1:7447")
    parser.add_argument("--connect", action="append", metavar="E", help="where it connects to; may be repeated")


def read_session(given: argparse.Namespace) -> SessionOptions:
    """Return what a program was told by the options of `add_session`.

    Raises:
        ConfigError: it is not allowed; the message lists all that is wrong.
    """
    raw, source = {}, _COMMAND_LINE
    if given.session is not None:
        source = str(given.session)
        try:
            raw = json.loads(given.session.read_text(encoding="utf-8"))
        except (OSError, ValueError) as failure:
            raise ConfigError(f"it cannot be read: {failure}", source=source) from failure
        if not isinstance(raw, dict):
            raise ConfigError("this is no table", source=source)
    told = {name: value for name in ("mode", "listen", "connect") if (value := getattr(given, name)) is not None}
    return validate_options(SessionOptions, {**raw, **told}, source, "session")


@contextmanager
def refusing(parser: argparse.ArgumentParser) -> Iterator[None]:
    """End a program with its own error message, and code 2, where what it was told cannot be done."""
    try:
        yield
    except SoterError as failure:
        parser.exit(2, f"{parser.prog}: error: {failure}\n")
