"""The commands put together. A command imports what it needs when it is called, so that `soter --help` is quick."""

from __future__ import annotations

from typing import Annotated

import typer

from soter.cli.ablate import EXAMPLES as ABLATE_EXAMPLES
from soter.cli.ablate import ablate
from soter.cli.backends import backends
from soter.cli.check import EXAMPLES as CHECK_EXAMPLES
from soter.cli.check import check
from soter.cli.conform import EXAMPLES as CONFORM_EXAMPLES
from soter.cli.conform import conform
from soter.cli.info import EXAMPLES as INFO_EXAMPLES
from soter.cli.info import info
from soter.cli.new import new
from soter.cli.plain import emit, guard_streams
from soter.cli.replay import EXAMPLES as REPLAY_EXAMPLES
from soter.cli.replay import replay
from soter.cli.report import EXAMPLES as REPORT_EXAMPLES
from soter.cli.report import report
from soter.cli.ros2 import MONITOR_EXAMPLES as ROS2_MONITOR_EXAMPLES
from soter.cli.ros2 import MUX_CONTEXT, ros2_monitor, ros2_mux, sim_ros2
from soter.cli.ros2 import SIM_EXAMPLES as ROS2_SIM_EXAMPLES
from soter.cli.run import EXAMPLES, run
from soter.cli.sim import sim
from soter.cli.tune import EXAMPLES as TUNE_EXAMPLES
from soter.cli.tune import tune
from soter.cli.verify import EXAMPLES as VERIFY_EXAMPLES
from soter.cli.verify import verify
from soter.cli.zenoh import MUX_CONTEXT as ZENOH_MUX_CONTEXT
from soter.cli.zenoh import SIM_EXAMPLES as ZENOH_SIM_EXAMPLES
from soter.cli.zenoh import sim_zenoh, zenoh_mux
from soter.cli.zenoh_router import EXAMPLES as ZENOH_ROUTER_EXAMPLES
from soter.cli.zenoh_router import zenoh_router

app = typer.Typer(
    name="soter",
    help="Run-time assurance for robots: untrusted controllers do the work, declared safety modules keep the rules.",
    epilog="Example:  soter run examples/surveillance.toml --picture run.png",
    no_args_is_help=True,
    add_completion=False,
    # A fault of SOTER itself ends in Python's own traceback, see soter.cli.exits.
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_MISSIONS = "Missions"
_RECORDINGS = "Recordings"
_ROBOTS = "Robots and their adapters"
_WIRES = "Programs beside robots"

app.command(epilog=EXAMPLES, rich_help_panel=_MISSIONS)(run)
app.command(epilog=CHECK_EXAMPLES, rich_help_panel=_MISSIONS)(check)
app.command(epilog=TUNE_EXAMPLES, rich_help_panel=_MISSIONS)(tune)
app.command(epilog=ABLATE_EXAMPLES, rich_help_panel=_MISSIONS)(ablate)
app.command(epilog=REPORT_EXAMPLES, rich_help_panel=_RECORDINGS)(report)
app.command(epilog=INFO_EXAMPLES, rich_help_panel=_RECORDINGS)(info)
app.command(epilog=VERIFY_EXAMPLES, rich_help_panel=_RECORDINGS)(verify)
app.command(epilog=REPLAY_EXAMPLES, rich_help_panel=_RECORDINGS)(replay)
app.command(rich_help_panel=_ROBOTS)(backends)
app.command(epilog=CONFORM_EXAMPLES, rich_help_panel=_ROBOTS)(conform)
sim.command("ros2", epilog=ROS2_SIM_EXAMPLES)(sim_ros2)
sim.command("zenoh", epilog=ZENOH_SIM_EXAMPLES)(sim_zenoh)
app.add_typer(sim, rich_help_panel=_ROBOTS)
app.add_typer(new, rich_help_panel=_ROBOTS)
app.command(context_settings=MUX_CONTEXT, rich_help_panel=_WIRES)(ros2_mux)
app.command(epilog=ROS2_MONITOR_EXAMPLES, rich_help_panel=_WIRES)(ros2_monitor)
app.command(context_settings=ZENOH_MUX_CONTEXT, rich_help_panel=_WIRES)(zenoh_mux)
app.command(epilog=ZENOH_ROUTER_EXAMPLES, rich_help_panel=_WIRES)(zenoh_router)


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
    """Take the options that stand before a command; they have callbacks of their own."""


def main() -> None:
    """Run the command line and exit."""
    guard_streams()
    app(prog_name="soter")
