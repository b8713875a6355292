"""Consoles for the output of commands, to people and to programs."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from soter.cli.plain import behind, plain


class HumanConsole(Console):
    """A rich console on which printed texts cannot set colours or move the cursor."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yield the segments of a renderable, without control characters in its texts."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(plain(segment.text), segment.style)


def make_console(*, stderr: bool = False) -> HumanConsole:
    """Return a console on standard output or standard error.

    Files and pipes get no colours and no control characters, unless FORCE_COLOR asks for them.
    """
    file = behind(sys.stderr if stderr else sys.stdout)
    return HumanConsole(file=file, highlight=False, markup=False, emoji=False)


def is_live(console: Console) -> bool:
    """Return whether a display on this console may overwrite itself, on a terminal that can move its cursor."""
    return console.file.isatty() and not console.is_dumb_terminal


def print_table(
    console: Console, head: Sequence[str], rows: Iterable[Sequence[RenderableType]], gives_way: int = 0
) -> None:
    """Print a table; if there is little room, the column `gives_way` is folded, and nothing is cut off."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for index, column in enumerate(head):
        table.add_column(column, no_wrap=index != gives_way, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print(table)
