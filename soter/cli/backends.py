"""`soter backends`."""

from __future__ import annotations

from soter.cli.exits import guard


def backends() -> None:
    """List the backends: which can be used here, what their robots promise, what to install for the others."""
    with guard():
        from rich import box
        from rich.table import Table
        from rich.text import Text

        from soter.cli.console import make_console
        from soter.registry import list_backends

        rows = list_backends()
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        table.add_column("backend", no_wrap=True)
        table.add_column("state", no_wrap=True)
        table.add_column("from", no_wrap=True)
        table.add_column("its robots")
        for row in rows:
            state = Text("ready", "green") if row.available else Text("not available", "yellow")
            table.add_row(row.name, state, row.origin, row.capabilities)
        console = make_console()
        console.print(table)
        # Not in the table: a command that is broken into lines cannot be copied.
        for row in rows:
            if not row.available:
                console.print(row.problem, soft_wrap=True)
