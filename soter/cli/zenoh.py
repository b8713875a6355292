"""`soter zenoh-mux` and `soter sim zenoh`."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli import sim
from soter.cli.exits import StopSignals, guard
from soter.cli.option import option
from soter.cli.plain import emit

if TYPE_CHECKING:
    from soter.adapters.zenoh.simulator import ZenohSimulator

SIM_EXAMPLES = """Examples:
  soter sim zenoh examples/surveillance.xml
  soter sim zenoh examples/surveillance.xml --robots 1 --listen tcp/127.0.0.1:7447
  soter sim zenoh examples/surveillance.xml --mode client --connect tcp/127.0.0.1:7447
Exit codes:
  0  ended by Ctrl-C or a request to terminate
  2  bad input, an endpoint that cannot be used, or Zenoh is not there
"""

# The mux has a parser and help of its own, which `python -m soter.adapters.zenoh.mux` uses as well.
MUX_CONTEXT = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}


def zenoh_mux(context: typer.Context) -> None:
    """Run the mux of one robot: beside the robot's base, between its two controllers and the base."""
    with guard():
        from soter.registry import load_backend

        load_backend("zenoh")
        from soter.adapters.zenoh.mux import main

        main(context.args)


def sim_zenoh(
    workspace: sim.WorkspaceFile,
    listen: Annotated[
        list[str] | None,
        option("E", "Where the world listens, such as tcp/127.0.0.1:7447; a free port of this host otherwise."),
    ] = None,
    connect: Annotated[list[str] | None, option("E", "Where the robots connect to, such as a router.")] = None,
    mode: Annotated[str | None, option("M", "What their sessions are: peer, which is the default, or client.")] = None,
    session: Annotated[
        Path | None, option("FILE", "All about the session: the keys of \\[backends.zenoh.session], as TOML.")
    ] = None,
    robots: sim.FirstRobots = None,
    stamped: sim.Stamped = False,
    speedup: Annotated[float, option("N", "Simulated seconds by second.", min=0.1)] = 1.0,
    truth: sim.TruthPort = 0,
    separation: sim.Separation = 0.3,
    clearance: sim.BoxClearance = 0.0,
    seed: sim.ChargeSeed = None,
) -> None:
    """Simulate robots on Zenoh, each with its mux, until Ctrl-C. Only this host reaches them unless told otherwise."""
    with guard(), StopSignals() as stop:
        from soter.registry import load_backend

        load_backend("zenoh")
        from soter.adapters.zenoh.programs import session_options
        from soter.adapters.zenoh.simulator import ZenohSimulator
        from soter.sdk import RuleLimits

        options = session_options(session, mode=mode, listen=listen or None, connect=connect or None)
        room, specs = sim.room_and_robots(workspace, robots, seed)
        opened = ZenohSimulator(
            room, specs, options, stamped=stamped, speedup=speedup, truth_port=truth,
            limits=RuleLimits(separation, clearance),
        )  # fmt: skip
        with closing(opened) as simulator:
            _say_how_to_connect(simulator, stamped=stamped, speedup=speedup)
            sim.keep(simulator, stop)


def _say_how_to_connect(simulator: ZenohSimulator, *, stamped: bool, speedup: float) -> None:
    """Print the keys of a mission file that connect to the robots, and the Zenoh keys for other programs."""
    from soter.adapters.zenoh.options import CLOCK

    session = simulator.session
    lines = [
        "[backends.zenoh]", f'truth = "{simulator.truth}"', f'session.mode = "{session.mode}"',
        f"session.connect = [{', '.join(map(repr, session.connect))}]",
        *(["stamped = true"] if stamped else []), *([f"speedup = {speedup:g}"] if speedup != 1.0 else []),
        *(f'robots.{robot_id}.namespace = "{name}"' for robot_id, name in simulator.namespaces.items()),
    ]  # fmt: skip
    emit("In a mission file:\n\n" + "\n".join(lines))
    twist = "geometry_msgs/TwistStamped" if stamped else "geometry_msgs/Twist"
    keys = {
        "odom": "nav_msgs/Odometry, 30 Hz",
        "battery_state": "sensor_msgs/BatteryState, 2 Hz",
        "cmd_vel_ac": f"{twist}, to the mux",
        "cmd_vel_sc": f"{twist}, to the mux",
        "cmd_vel": f"{twist}, from the mux to the base",
        CLOCK: "rosgraph_msgs/Clock, 60 Hz",
        "soter/order": "std_msgs/String, to the mux",
        "soter/gate": "std_msgs/String, from the mux",
    }
    emit("\nKeys, all of them CDR:\n")
    for name in simulator.namespaces.values():
        emit("\n".join(f"{f'{name}/{key}':28}{what}" for key, what in keys.items()))
    emit("\nCtrl-C ends it.")
