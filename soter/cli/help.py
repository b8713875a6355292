"""Makes `--help` fit the terminal, and quick: only needed options are loaded."""

from __future__ import annotations

import copy
import re
import shutil
import textwrap
from collections.abc import Callable, Container
from typing import Any, Final

import typer

_EXIT_CODE: Final = re.compile(r"  \d+  ")
_PARAGRAPHS: Final = re.compile(r"\n+(?! {3})")
_INDENT: Final = "      "
_LEAST_COLUMNS: Final = 40


def only(whole: typer.Typer, words: Container[str]) -> typer.Typer:
    """Return the app; commands not named in `words` are listed without options, as only their help line is printed.

    Reading the options of all of them takes longer than everything else that `soter --help` does.
    """
    part = copy.copy(whole)
    part.registered_commands = [
        each if (each.name or _name(each.callback)) in words else _bare(each) for each in whole.registered_commands
    ]
    part.registered_groups = [
        each if each.typer_instance is None or each.typer_instance.info.name in words else _bare_group(each)
        for each in whole.registered_groups
    ]
    return part


def _name(function: Callable[..., Any] | None) -> str:
    return function.__name__.replace("_", "-") if function is not None else ""


def _bare(command: Any) -> Any:
    def never() -> None:
        raise AssertionError("a command that is not named is not called")

    never.__name__, never.__doc__ = command.callback.__name__, command.callback.__doc__
    bare = copy.copy(command)
    bare.callback = never
    return bare


def _bare_group(group: Any) -> Any:
    bare = copy.copy(group)
    bare.typer_instance = copy.copy(group.typer_instance)
    bare.typer_instance.registered_commands = []
    return bare


def tidy(command: Any, columns: int | None = None, above: typer.Context | None = None) -> None:
    """Fit the help of a command, and of all its subcommands, to the terminal.

    Arguments and options without a value name no type, paragraphs lose the line breaks of their source, and epilogs are
    broken where a reader would break them.

    Args:
        command: a command made by typer.
        columns: width of the terminal; None for the actual one.
        above: the context of the parent command, which has the names of the help options.
    """
    context = typer.Context(command, above, **command.context_settings)
    width = max(_LEAST_COLUMNS, (columns or shutil.get_terminal_size().columns) - 2)
    # Includes the help option.
    for option in command.get_params(context):
        if getattr(option, "is_flag", False):
            option.metavar = ""
        if option.param_type_name == "argument":
            # Its name shows the kind of value, such as FILE.mcap; typer would add the Python type.
            option.display_type_rich = lambda ctx: None
    if command.help:
        command.help = "\n\n".join(" ".join(each.split()) for each in command.help.split("\n\n"))
    if command.epilog:
        command.epilog = fit(command.epilog, width)
    for each in getattr(command, "commands", {}).values():
        tidy(each, columns, context)


def fit(epilog: str, width: int) -> str:
    """Return an epilog in lines of at most `width` characters; broken commands can still be pasted into a shell.

    Every line is a paragraph, together with the further indented lines after it.
    """
    return "\n\n".join(_paragraph(each, width) for each in _PARAGRAPHS.split(epilog.rstrip()))


def _paragraph(text: str, width: int) -> str:
    if text.startswith("  soter "):
        return _command(text, width)
    code = _EXIT_CODE.match(text)
    indent = " " * len(code[0]) if code is not None else ""
    lines = textwrap.wrap(" ".join(text[len(indent) :].split()), width, subsequent_indent=indent,
                          initial_indent=code[0] if code is not None else "")  # fmt: skip
    return "\n".join(lines)


def _command(text: str, width: int) -> str:
    """Break a command before options; an option stays together with its value."""
    first, *options = re.split(r" (?=--?[a-z])", text)
    lines = [first]
    for option in options:
        # Room for the backslash that continues a line.
        if len(lines[-1]) + 1 + len(option) + 2 <= width:
            lines[-1] += f" {option}"
        else:
            lines.append(f"{_INDENT}{option}")
    return " \\\n".join(lines)
