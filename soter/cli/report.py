"""`soter report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from soter.cli.exits import ExitCode, Force, complain, guard
from soter.cli.option import option
from soter.cli.overrides import RecordingArgument
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from soter.record.reader import Recording
    from soter.report.caption import Caption

EXAMPLES = """Examples:
  soter report run.mcap
  soter report run.mcap -o page.html
  soter report run.mcap --png run.png --gif run.gif
  soter report run.mcap --mp4 run.mp4 --film 120
  soter report run.mcap --still still.png --at 90
Exit codes:
  0  what was asked for was written, of a recording that was cut off as far as it goes
  2  it is no recording, or damaged; or a file cannot be written
  3  a file could not be written after all
"""
_NAMES: Final = {"--output": "page", "--png": "picture", "--gif": "film", "--mp4": "film", "--still": "still"}


def report(
    recording: RecordingArgument,
    output: Annotated[
        Path | None,
        option(
            "PAGE.html",
            "Where the page goes: beside the recording by default, and nowhere if only pictures are asked for.",
            "--output",
            "-o",
        ),
    ] = None,
    png: Annotated[Path | None, option("FILE.png", "Draw the run.")] = None,
    gif: Annotated[Path | None, option("FILE.gif", "Draw the run as a film.")] = None,
    mp4: Annotated[Path | None, option("FILE.mp4", "The same, smoother and smaller; it needs PyAV.")] = None,
    film: Annotated[
        float,
        option(
            "SECONDS",
            "How long a film may take. It is ten times as fast as the run, or as much faster as that takes.",
            min=1.0,
            max=3600.0,
        ),
    ] = 60.0,
    still: Annotated[Path | None, option("FILE.png", "Show the world in three dimensions; it needs PyBullet.")] = None,
    at: Annotated[float | None, option("SECONDS", "The moment of --still; else the end.", min=0.0)] = None,
    force: Force = False,
) -> None:
    """Make a page of a recording that plays it in any browser, without a network."""
    with guard():
        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs
        from soter.record.reader import Recording

        if at is not None and still is None:
            raise option_error("--at", "it is the moment of --still, which is not given")
        console = make_console()
        opened = Recording(recording)
        wanted = {"--output": output, "--png": png, "--gif": gif, "--mp4": mp4, "--still": still}
        if not any(wanted.values()):
            wanted["--output"] = recording.with_suffix(".html")
        files = Outputs(wanted, [recording], force=force)
        made = {option: _made(option, opened, film, at) for option in files.files}
        if opened.truncated:
            console.print(f"{recording} was cut off: what follows is what there is", soft_wrap=True)
        failed = False
        for option_name, data in made.items():
            what = _NAMES[option_name]
            try:
                files.files[option_name].write(data)
            except OSError as failure:
                failed = True
                complain(f"the {what} could not be written: {failure}")
            else:
                console.print(f"{what}: {wanted[option_name]} ({len(data) / 1e6:.1f} MB)", soft_wrap=True)
        if failed:
            raise typer.Exit(ExitCode.RUN_FAILED)


def _made(option_name: str, recording: Recording, most_s: float, at_s: float | None) -> bytes:
    """Return the content of an option's file: a page, a picture, a film of at most `most_s`, or a still at `at_s`."""
    if option_name == "--output":
        from soter.report.page.html import make_page

        return make_page(recording).encode()
    if option_name == "--still":
        from soter.cli.still import draw_still

        return draw_still(recording, at_s)
    tracks, words = recording.tracks(), _caption(recording)
    if option_name == "--gif":
        from soter.report.film import draw_gif

        return draw_gif(tracks, words, most_s)
    if option_name == "--mp4":
        from soter.report.mp4 import draw_mp4

        return draw_mp4(tracks, words, most_s)
    from soter.report.picture import draw_png

    return draw_png(tracks, words)


def _caption(recording: Recording) -> Caption:
    """Return the words of a picture: those of the result, or, without a result, of a recording that was cut off."""
    from pydantic import ValidationError

    from soter.cli.summary import caption
    from soter.config import MissionFile
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
