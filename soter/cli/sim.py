"""`soter sim`: simulated robots on a wire, in a process of their own."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from soter.cli.exits import StopSignals, guard
from soter.cli.option import option, switch
from soter.cli.plain import emit
from soter.errors import BackendUnavailable, ConfigError, RunFailed

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.adapters.velocity_controlled.simulator import VelocityControlledSimulator
    from soter.geometry.workspace import Workspace
    from soter.sdk.values import RobotSpec
    from soter_sim.mavlink.simulation import Settings, Simulation

MAVLINK_EXAMPLES = """Examples:
  soter sim mavlink examples/surveillance.xml
  soter sim mavlink examples/surveillance.xml --tcp --speedup 4 --robots 1
  soter sim mavlink examples/surveillance.xml --vehicle copter --boot 42
Exit codes:
  0  ended by Ctrl-C or a request to terminate
  2  bad input, or a port that is taken
"""

_UDP_PORT = 14550
_TCP_PORT = 5760

sim = typer.Typer(
    name="sim",
    help="Simulate robots on a wire, for SOTER or for anything else that speaks to such robots.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def room_and_robots(path: Path, robots: int | None, seed: int | None) -> tuple[Workspace, list[RobotSpec]]:
    """Return a workspace with its first robots, or all; their charges are drawn from a seed, or full without one.

    Raises:
        ConfigError: the file is no workspace, or has fewer robots.
    """
    from soter.config import draw_charge
    from soter.geometry.reading import read_workspace
    from soter.sdk.values import RobotSpec

    room = read_workspace(path)
    if robots is not None:
        room = room.with_robots(robots)
    return room, [
        RobotSpec(
            place.id, place.x_m, place.y_m, place.heading_rad, None if seed is None else draw_charge(seed, place.id)
        )
        for place in room.robots
    ]


WorkspaceFile = Annotated[
    Path, typer.Argument(metavar="WORKSPACE", help="The workspace file (XML).", show_default=False)
]
FirstRobots = Annotated[int | None, option("N", "Only the first N of the workspace.")]
Stamped = Annotated[bool, switch("--stamped", "Velocities are TwistStamped instead of Twist.")]
TruthPort = Annotated[int, option("P", "The port that tells what really happens; 0 for any that is free.")]
Separation = Annotated[
    float,
    option("M", "Nearer centres collide, by the truth: rta.collision.phi_safe_m.", min=0.0),
]
BoxClearance = Annotated[
    float,
    option("M", "Nearer to a box no body may be, by the truth: rta.obstacle.phi_safe_m.", min=0.0),
]
ChargeSeed = Annotated[int | None, option("N", "Draw the charges at the start from it; all are full without it.")]

_LOOK_S = 0.1


def keep(simulator: VelocityControlledSimulator, stop: Callable[[], bool]) -> None:
    """Keep a simulator until told to stop.

    Raises:
        RunFailed: the simulator's world has ended by itself.
    """
    while not stop():
        if simulator.world.poll() is not None:
            raise RunFailed(f"the world ended with code {simulator.world.returncode}")
        time.sleep(_LOOK_S)


@sim.command(epilog=MAVLINK_EXAMPLES)
def mavlink(
    workspace: WorkspaceFile,
    port: Annotated[
        int | None,
        option(
            "P",
            f"The port on which a ground station listens, {_UDP_PORT} if not given; with --tcp the port on which "
            f"the vehicles listen, {_TCP_PORT} if not given, 0 for any that is free.",
            show_default=False,
        ),
    ] = None,
    tcp: Annotated[bool, switch("--tcp", "TCP, with the vehicles as the server; else UDP.")] = False,
    vehicle: Annotated[
        Literal["rover", "copter"] | None,
        typer.Option(help="What the robots are; rovers if nothing says otherwise.", show_default=False),
    ] = None,
    like: Annotated[
        Literal["ardurover", "ardurover-boat", "arducopter", "px4"] | None,
        typer.Option(help="Like a real autopilot, with its flaws, and nothing that it lacks.", show_default=False),
    ] = None,
    engine: Annotated[
        Literal["kinematic", "pybullet"], typer.Option(help="What moves them; copters have the kinematic one only.")
    ] = "kinematic",
    robots: FirstRobots = None,
    rate: Annotated[
        float | None, option("HZ", "Control periods in a second, and messages of one kind at most.", min=10.0)
    ] = None,
    speedup: Annotated[float, option("N", "Simulated seconds by second, at most.")] = 1.0,
    boot: Annotated[float, option("SECONDS", "Simulated time until the autopilots are ready.")] = 2.0,
    origin: Annotated[
        str | None,
        option("LAT,LON,ALT", "Where on earth a workspace in metres has its origin; negative: --origin=-33.9,18.4,10."),
    ] = None,
    sign: Annotated[
        Path | None, option("PASSPHRASE-FILE", "Sign packets with the passphrase in this file, and drop all others.")
    ] = None,
    truth: TruthPort = 0,
    separation: Separation = 0.3,
    clearance: BoxClearance = 0.0,
    seed: ChargeSeed = None,
) -> None:
    """Simulate vehicles that speak MAVLink, until Ctrl-C. Nothing outside this host can reach them."""
    with guard(), StopSignals() as stop:
        from soter.hints import install_command
        from soter.sdk.values import RuleLimits

        try:
            from soter_sim.mavlink.flaws import LIKE
            from soter_sim.mavlink.frames import Origin
            from soter_sim.mavlink.signing import read_key
            from soter_sim.mavlink.simulation import Settings, Simulation
        except ImportError as missing:
            raise BackendUnavailable(f"this needs pymavlink: {missing}; run: {install_command('mavlink')}") from missing

        room, specs = room_and_robots(workspace, robots, seed)
        try:
            settings = Settings(
                vehicle=vehicle or LIKE.get(like or "", "rover"),
                like=like,
                engine=engine,
                udp=() if tcp else (_UDP_PORT if port is None else port,),
                tcp=(_TCP_PORT if port is None else port,) if tcp else (),
                truth=truth,
                rate_hz=rate,
                speedup=speedup,
                boot_s=boot,
                origin=Origin() if origin is None else Origin.read(origin),
                key=None if sign is None else read_key(sign),
                limits=RuleLimits(separation, clearance),
            )
            simulation = Simulation(room, specs, settings)
        except ImportError as missing:
            raise BackendUnavailable(
                f"the engine '{engine}' needs PyBullet: {missing}; run: {install_command('pybullet')}; the engine "
                "'kinematic' needs nothing"
            ) from missing
        except (ValueError, OSError) as failure:
            raise ConfigError(str(failure), source="command line") from failure
        with simulation:
            _say_how_to_connect(simulation, settings)
            simulation.run(lambda: not stop())


def _say_how_to_connect(simulation: Simulation, settings: Settings) -> None:
    """Print the commands and settings with which other programs connect to the vehicles."""
    (link,) = simulation.links
    kind, host, port = link.address.split(":")
    names = ", ".join(str(autopilot.id) for autopilot in simulation.autopilots)
    many = len(simulation.autopilots) > 1
    emit(f"{settings.kind.name}{'s' if many else ''} with system id{'s' if many else ''} {names}, until Ctrl-C")
    emit("")
    emit(f"SOTER           {link.address}")
    emit(f"MAVProxy        mavproxy.py --master={link.address}")
    if kind == "tcp":
        emit(f"QGroundControl  Application Settings, Comm Links, Add: TCP, {host}, {port}")
        emit(f'MAVSDK          add_any_connection("tcpout://{host}:{port}")')
    else:
        listens = "by itself" if int(port) == _UDP_PORT else f"Application Settings, Comm Links, Add: UDP, {port}"
        emit(f"QGroundControl  {listens}")
        emit(f'MAVSDK          add_any_connection("udpin://{host}:{port}")')
    emit(f"truth           tcp://{simulation.truth.address}, JSON lines")
    if settings.key is not None:
        emit("signed          with the passphrase; what is not signed with it is dropped")
    emit("")
