"""`soter report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.exits import ExitCode, Force, complain, guard

if TYPE_CHECKING:
    from rich.console import Console

    from soter.cli.outputs import Output
    from soter.record.reader import Recording
    from soter.report.caption import Caption

# A blank line keeps two lines from being joined.
EXAMPLES = """Examples:

  soter report run.mcap

  soter report run.mcap -o page.html

  soter report run.mcap --png run.png --gif run.gif

Exit codes:

  0  what was asked for was written, of a recording that was cut off as far as it goes

  2  it is no recording, or damaged; or a file cannot be written

  3  a file could not be written after all
"""


def report(
    recording: Annotated[Path, typer.Argument(metavar="FILE.mcap", help="The recording.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="PAGE.html",
            help="Where the page goes: beside the recording by default, and nowhere if only pictures are asked for.",
        ),
    ] = None,
    png: Annotated[Path | None, typer.Option("--png", metavar="FILE.png", help="Draw the run.")] = None,
    gif: Annotated[Path | None, typer.Option("--gif", metavar="FILE.gif", help="Draw the run as it went on.")] = None,
    force: Force = False,
) -> None:  # fmt: skip
    """Make a page of a recording that plays it in any browser, without a network."""
    with guard():
        from soter.cli.console import make_console
        from soter.cli.outputs import Output, picture_output, refuse_clashes
        from soter.record.reader import Recording

        console = make_console()
        opened = Recording(recording)
        if output is None and png is None and gif is None:
            output = recording.with_suffix(".html")
        refuse_clashes({"--output": output, "--png": png, "--gif": gif}, [recording], force=force)
        page_file = None if output is None else Output(output, "--output")
        png_file = None if png is None else picture_output(png, "--png")
        gif_file = None if gif is None else picture_output(gif, "--gif", ".gif")
        made: list[tuple[str, Output, bytes]] = []
        if page_file is not None:
            from soter.report.page.html import make_page

            made.append(("page", page_file, make_page(opened).encode()))
        if png_file is not None or gif_file is not None:
            from soter.report.animation import draw_gif
            from soter.report.picture import draw_png

            tracks, words = opened.tracks(), _caption(opened)
            if png_file is not None:
                made.append(("picture", png_file, draw_png(tracks, words)))
            if gif_file is not None:
                made.append(("animation", gif_file, draw_gif(tracks, words)))
        if opened.truncated:
            console.print(f"{recording} was cut off: what follows is what there is", soft_wrap=True)
        written = [_written(console, *each) for each in made]
        if not all(written):
            raise typer.Exit(ExitCode.RUN_FAILED)


def _caption(recording: Recording) -> Caption:
    """Return the words of a picture: those of the result, or what is known of a run that did not get to have one."""
    from pydantic import ValidationError

    from soter.cli.summary import caption
    from soter.config import MissionFile
    from soter.errors import ConfigError
    from soter.report.caption import Caption
    from soter.runner.result import RunResult

    result = recording.result_json
    if result is None:
        return Caption(title=f"{Path(recording.about.source).stem or 'mission'}: a recording that was cut off")
    try:
        safer_charge = MissionFile.model_validate(recording.about.mission).rta.battery.phi_safer
        return caption(RunResult.model_validate_json(result), safer_charge)
    except ValidationError as failure:
        raise ConfigError(f"{recording.path}: its result or mission is not of this version: {failure}") from failure


def _written(console: Console, what: str, file: Output, data: bytes) -> bool:
    try:
        file.write(data)
    except OSError as failure:
        complain(f"the {what} could not be written: {failure}")
        return False
    console.print(f"{what}: {file.path} ({len(data) / 1e6:.1f} MB)", soft_wrap=True)
    return True
