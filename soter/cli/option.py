"""Options of commands, a line each: what stands for the value, and what the help says."""

from __future__ import annotations

from typing import Any

import typer


def option(metavar: str, text: str, *names: str, **more: Any) -> Any:
    """Return an option that takes a value; without names it is called as its parameter is.

    Args:
        metavar: what stands for the value.
        text: what the help says.
        names: such as "--output" and "-o".
        more: for `typer.Option`.
    """
    return typer.Option(*names, metavar=metavar, help=text, **more)


def switch(name: str, text: str, **more: Any) -> Any:
    """Return an option that takes no value; see `option`."""
    return typer.Option(name, help=text, **more)
