"""Assembles the commands. Each command imports its libraries when it is called, so that `soter --help` is quick."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from typing import Annotated, Final

import typer

from soter.cli import (
    ablate,
    backends,
    campaign,
    campaign_results,
    check,
    compare,
    conform,
    download,
    info,
    measure,
    new,
    replay,
    report,
    ros2,
    run,
    sim,
    tune,
    verify,
    workspace,
    zenoh,
    zenoh_router,
)
from soter.cli.complete import answer
from soter.cli.exits import ExitCode, complain_of_room
from soter.cli.help import only, tidy
from soter.cli.plain import emit, guard_streams

app = typer.Typer(
    name="soter",
    help="Run-time assurance for robots: untrusted controllers do the work, declared safety modules keep the rules.",
    epilog="Example:  soter run examples/surveillance.toml --picture run.png",
    no_args_is_help=True,
    # A fault of SOTER itself ends in Python's own traceback, see soter.cli.exits.
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_ENDS_S: Final = 5.0
_WIRES = "Programs beside robots"
_ROBOTS = "Robots and their adapters"

for _panel, _modules in {
    "Missions": (run, check, tune, ablate, workspace),
    "Recordings": (report, compare, info, verify, replay),
    _ROBOTS: (backends, measure, conform, download),
}.items():
    for _module in _modules:
        _command = getattr(_module, _module.__name__.rpartition(".")[2])
        app.command(epilog=getattr(_module, "EXAMPLES", None), rich_help_panel=_panel)(_command)
campaign.campaign.command(epilog=campaign_results.REPORT_EXAMPLES)(campaign_results.report)
campaign.campaign.command(epilog=campaign_results.COMPARE_EXAMPLES)(campaign_results.compare)
app.add_typer(campaign.campaign, rich_help_panel="Missions")
sim.sim.command("ros2", epilog=ros2.SIM_EXAMPLES)(ros2.sim_ros2)
sim.sim.command("zenoh", epilog=zenoh.SIM_EXAMPLES)(zenoh.sim_zenoh)
app.add_typer(sim.sim, rich_help_panel=_ROBOTS)
app.add_typer(new.new, rich_help_panel=_ROBOTS)
app.command(context_settings=ros2.MUX_CONTEXT, rich_help_panel=_WIRES)(ros2.ros2_mux)
app.command(epilog=ros2.MONITOR_EXAMPLES, rich_help_panel=_WIRES)(ros2.ros2_monitor)
app.command(context_settings=zenoh.MUX_CONTEXT, rich_help_panel=_WIRES)(zenoh.zenoh_mux)
app.command(epilog=zenoh_router.EXAMPLES, rich_help_panel=_WIRES)(zenoh_router.zenoh_router)


def _show_version(wanted: bool) -> None:
    if wanted:
        from soter import __version__

        emit(f"soter {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Accept the options before a command; they have callbacks of their own."""


def main() -> None:
    """Run the command line and exit."""
    files = guard_streams(complain_of_room)
    # Completion needs the options of commands that are not named yet.
    completes = "_SOTER_COMPLETE" in os.environ
    try:
        command = typer.main.get_command(app if completes else only(app, sys.argv))
        tidy(command)
    except KeyboardInterrupt:
        raise SystemExit(ExitCode.INTERRUPTED) from None
    before = {*threading.enumerate()}
    try:
        if completes:
            answer(lambda: command(prog_name="soter"))
        command(prog_name="soter")
    except SystemExit as end:
        for stream in (sys.stdout, sys.stderr):
            # Foreign code may have closed or replaced the stream.
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        if any(file.full for file in files):
            end.code = ExitCode.RUN_FAILED
        if any(not thread.daemon for thread in {*threading.enumerate()} - before):
            # Foreign code may have left threads that never end, for which Python would wait.
            last = threading.Timer(_ENDS_S, os._exit, [end.code or 0])
            last.daemon = True
            last.start()
        raise
