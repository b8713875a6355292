"""Short forms for options of commands: placeholder of the value and help text."""

from __future__ import annotations

from typing import Any

import typer


def option(metavar: str, text: str, *names: str, **more: Any) -> Any:
    """Return an option that takes a value, shown as `metavar`; without names, it is named after its parameter."""
    return typer.Option(*names, metavar=metavar, help=text, **more)


def switch(name: str, text: str, **more: Any) -> Any:
    """Return an option that takes no value; see `option`."""
    return typer.Option(name, help=text, **more)
