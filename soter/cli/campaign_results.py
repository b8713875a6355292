"""`soter campaign report` and `soter campaign compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.campaign import needs
from soter.cli.exits import Force, StopSignals, guard
from soter.cli.option import option
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from rich.console import Console

    from soter.campaign.store import Store

REPORT_EXAMPLES = """Examples:
  soter campaign report runs/thesis.sqlite
  soter campaign report runs/evaluation.sqlite --worst 3
  soter campaign report runs/evaluation.sqlite --into docs/evaluation.md
Exit codes:
  0  it is written
  2  bad input, or with --into: the campaign is not whole
"""
COMPARE_EXAMPLES = """Examples:
  soter campaign compare runs/evaluation.sqlite --left targets=grid --right targets=hostile
  soter campaign compare before.sqlite after.sqlite
Exit codes:
  0  they are compared, whatever came of it
  2  bad input, or nothing to compare
"""

Stored = Annotated[Path, typer.Argument(metavar="STORE", help="The store of a campaign.", show_default=False)]


def report(
    store: Stored,
    output: Annotated[
        Path | None, option("PAGE.html", "Where the page goes; beside the store.", "--output", "-o")
    ] = None,
    into: Annotated[
        Path | None, option("DOCUMENT.md", "Write tables into this document, between its marks, and no page.")
    ] = None,
    worst: Annotated[
        int, option("N", "Record the N runs with the least margins, each with a page.", min=0, max=100)
    ] = 0,
    force: Force = False,
) -> None:
    """Make a page of a campaign: tables that sort, margins over runs, links to pages of single runs."""
    with guard():
        needs("scipy")
        from soter.campaign.again import campaign_of
        from soter.campaign.report.page import make_page
        from soter.campaign.store import Store
        from soter.campaign.summary import judge
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs

        console = make_console()
        with Store(store) as kept:
            read = campaign_of(kept)
            judged = judge(read, kept)
            if into is not None:
                from soter.campaign.report.document import section, write

                if not kept.about().get("whole"):
                    raise ConfigError("its campaign is not whole: carry it on to its end first", source=str(store))
                write(into, section(read, kept, judged))
                console.print(f"written: {into}", soft_wrap=True)
                return
            output = output or store.with_suffix(".html")
            files = Outputs({"--output": output}, [store], force=force)
            folder = output.with_name(f"{output.stem}-runs")
            if worst:
                _record_worst(kept, worst, folder, console)
            data = make_page(kept, judged, folder).encode()
        files.write("--output", lambda: data)
        console.print(f"page: {output} ({len(data) / 1e6:.1f} MB)", soft_wrap=True)


def _record_worst(store: Store, count: int, folder: Path, console: Console) -> None:
    """Repeat the runs with the least margins, record them, and make a page of each."""
    from soter.campaign.again import job_of
    from soter.campaign.conditions import figure
    from soter.campaign.job import carry_out
    from soter.record.reader import Recording
    from soter.report.page.html import make_page

    margins = [(margin, row.id, row) for row in store.rows() if (margin := figure(row, "min_margin")) is not None]
    folder.mkdir(exist_ok=True)
    with StopSignals() as stop:
        for margin, name, row in sorted(margins, key=lambda each: each[:2])[:count]:
            recording = folder / f"{name}.mcap"
            if not recording.exists() and not stop():
                carry_out(job_of(store, row), stop, recording)
                recording.with_suffix(".html").write_text(make_page(Recording(recording)), encoding="utf-8")
                console.print(f"{name}: least margin {margin:.4f}, recorded", soft_wrap=True)


def compare(
    left: Stored,
    right: Annotated[
        Path | None, typer.Argument(metavar="OTHER", help="The store of another campaign; the same if not given.")
    ] = None,
    left_is: Annotated[
        list[str] | None, option("AXIS=NAME", "Only such runs on the left; or part=NAME.", "--left")
    ] = None,
    right_is: Annotated[list[str] | None, option("AXIS=NAME", "Only such runs on the right.", "--right")] = None,
    output: Annotated[Path | None, option("PAGE.html", "Write a page too.", "--output", "-o")] = None,
    force: Force = False,
) -> None:
    """Compare two settings of a campaign, or two campaigns, run by run of the same seed."""
    with guard():
        needs("scipy")
        from soter.campaign.comparison import compare as compared
        from soter.campaign.comparison import pairs, select
        from soter.campaign.report.page import DIFFERENCE_HEAD, comparison_page, difference_cells
        from soter.campaign.store import Store
        from soter.cli.console import make_console, print_table
        from soter.cli.outputs import Outputs

        one, other = _wanted(left_is, "--left"), _wanted(right_is, "--right")
        if right is None and one == other:
            raise option_error("--right", "both sides are the same runs; say how they differ")
        files = Outputs({"--output": output}, [left, *([right] if right else [])], force=force)
        with Store(left) as first, Store(right or left) as second:
            paired = pairs(select(first.rows(), one), select(second.rows(), other), {*one, *other})
        if not paired:
            raise ConfigError("no run on the left has one of the same seed and setting on the right", key="--left")
        found = compared(paired)
        head = [each.replace(", ", ",\n").replace(" at ", "\nat ").replace(" - ", "\n- ") for each in DIFFERENCE_HEAD]
        # On a terminal of 80 columns, the table needs its longest name and its intervals in two lines each.
        rows = [[each.replace("_total", "_\ntotal") for each in difference_cells(one)] for one in found]
        print_table(make_console(), head, rows, gives_way=len(head) - 2)
        words = f"left: {left} {' '.join(left_is or ())}, right: {right or left} {' '.join(right_is or ())}"
        files.write("--output", lambda: comparison_page(words, found).encode())


def _wanted(given: list[str] | None, option: str) -> dict[str, str]:
    found = {}
    for each in given or ():
        axis, equals, name = each.partition("=")
        if not equals:
            raise option_error(option, f"it is '{each}', allowed: AXIS=NAME, or part=NAME")
        found[axis] = name
    return found
