"""`soter compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from soter.cli import complete
from soter.cli.exits import Force, guard
from soter.cli.option import option
from soter.errors import ConfigError

EXAMPLES = """Examples:
  soter compare before.mcap after.mcap
  soter compare before.mcap after.mcap -o beside.html
Exit codes:
  0  the page is written
  2  one of them is no recording, or damaged; or the page cannot be written
"""


def compare(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE.mcap",
            help="The recordings, two or more.",
            show_default=False,
            autocompletion=complete.recordings,
        ),
    ],
    output: Annotated[Path, option("PAGE.html", "Where the page goes.", "--output", "-o")] = Path("compare.html"),
    force: Force = False,
) -> None:
    """Make a page of recordings side by side: their figures, and replays that play in step."""
    with guard():
        from soter.campaign.report.beside import make_beside
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs
        from soter.record.reader import Recording

        if len(recordings) < 2:
            raise ConfigError("it names one recording, allowed: two or more; `soter report` makes a page of one")
        files = Outputs({"--output": output}, recordings, force=force)
        data = make_beside([Recording(path) for path in recordings]).encode()
        files.write("--output", lambda: data)
        make_console().print(f"page: {output} ({len(data) / 1e6:.1f} MB)", soft_wrap=True)
