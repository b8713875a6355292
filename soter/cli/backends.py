"""`soter backends`."""

from __future__ import annotations

from typing import Annotated

from soter.cli.exits import guard
from soter.cli.option import switch
from soter.cli.plain import emit


def backends(json: Annotated[bool, switch("--json", "Print it as JSON.")] = False) -> None:
    """List the backends: which can be used here, what their robots promise, what to install for the others."""
    with guard():
        from rich.text import Text

        from soter.registry import list_backends

        rows = list_backends()
        if json:
            from dataclasses import asdict
            from json import dumps

            emit(dumps([asdict(row) for row in rows], indent=2))
            return
        from soter.cli.console import make_console, print_table

        console = make_console()
        print_table(
            console,
            ("backend", "state", "from", "its robots"),
            [
                (row.name, Text("ready", "green") if row.available else Text("not available", "yellow"), row.origin,
                 row.capabilities)
                for row in rows
            ],
            gives_way=3,
        )  # fmt: skip
        # Below the table, since a command that is broken into lines cannot be copied.
        for row in rows:
            if not row.available:
                console.print(row.problem, soft_wrap=True)
