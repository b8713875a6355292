"""`soter ros2-mux`, `soter ros2-monitor` and `soter sim ros2`."""

from __future__ import annotations

from contextlib import closing, nullcontext
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli import sim
from soter.cli.exits import StopSignals, guard
from soter.cli.option import option, switch
from soter.cli.overrides import MissionArgument, Settings, load_with_engine, merge
from soter.cli.plain import emit

if TYPE_CHECKING:
    from soter.adapters.ros2.simulator import Ros2Simulator
    from soter.config import MissionFile
    from soter.sdk.wire import WireFleet

MONITOR_EXAMPLES = """Examples:
  soter ros2-monitor examples/ros2_external_ac/mission.toml
  ros2 topic echo /robot1/soter/mode
  ros2 topic echo /robot1/soter/disengagements
Exit codes:
  0  ended after --duration, or by Ctrl-C; the robots are stopped
  2  bad input, a robot that is not there, or an ill-formed module: nothing has moved
"""

SIM_EXAMPLES = """Examples:
  soter sim ros2 examples/surveillance.xml
  soter sim ros2 examples/surveillance.xml --robots 1 --domain 7
Exit codes:
  0  ended by Ctrl-C or a request to terminate
  2  bad input, or ROS 2 is not there
"""

MUX_CONTEXT = {"allow_extra_args": True, "ignore_unknown_options": True}


def ros2_mux(
    context: typer.Context,
    robot: Annotated[str, option("NAME", "The robot's namespace, such as robot1.")] = "",
) -> None:
    """Run the mux of one robot: on the robot, between its two controllers and its base.

    What follows --ros-args is ROS's own: remappings, parameters, log levels.
    """
    with guard():
        _require_ros()
        from soter.adapters.ros2.mux import main

        main(["--robot", robot, *context.args])


def ros2_monitor(
    mission: MissionArgument,
    duration: Annotated[
        float | None, option("SECONDS", "How long, in the robots' time; until Ctrl-C if not given.")
    ] = None,
    no_rta: Annotated[bool, switch("--no-rta", "Remove the decision modules, and nothing else.")] = False,
    settings: Settings = None,
) -> None:
    """Watch over ROS 2 robots that other nodes drive on cmd_vel_ac; take one over only to keep it safe.

    Nothing of the mission but its safety modules is run. Robots that the mission file does not name are looked for
    at /robot1, /robot2 and so on.
    """
    with guard(), StopSignals() as stop:
        _require_ros()
        from soter.adapters.ros2.telemetry import Telemetry
        from soter.missions.ros2_monitor import Watcher
        from soter.runner.real_time import real_time

        options = {"backend": "ros2", "duration_s": duration, "rta.enabled": False if no_rta else None}
        loaded = load_with_engine(mission, merge(options, settings))
        with _open(loaded) as fleet:
            with stop.raising():
                for robot in fleet.robots:
                    robot.init(_INIT_TIMEOUT_S)
            watcher = Watcher(loaded, loaded.read_workspace(), fleet, Telemetry(fleet.robots, loaded.rta.order))
            names = ", ".join(robot.node.get_namespace() for robot in fleet.robots)
            domain = fleet.robots[0].node.context.get_domain_id()
            guarded = ", ".join(loaded.rta.order) if loaded.rta.enabled else "no module"
            emit(f"watching over {names}, in ROS domain {domain}: {guarded}; Ctrl-C ends it")
            wanted = loaded.isolation.real_time
            with real_time(required=wanted == "always") if wanted != "never" else nullcontext():
                watcher.run(stop, duration)
        for robot_id, count in watcher.disengagements.items():
            emit(f"robot {robot_id}: taken over {count} times")
        if watcher.late_ticks:
            emit(f"{watcher.late_ticks} ticks came late")


def sim_ros2(
    workspace: sim.WorkspaceFile,
    robots: sim.FirstRobots = None,
    stamped: sim.Stamped = False,
    domain: Annotated[int | None, option("N", "The ROS domain; one that nobody uses here if not given.", min=0)] = None,
    truth: sim.TruthPort = 0,
    separation: sim.Separation = 0.3,
    clearance: sim.BoxClearance = 0.0,
    seed: sim.ChargeSeed = None,
) -> None:
    """Simulate ROS 2 robots, each with its mux, until Ctrl-C. Nothing outside this host can reach them."""
    with guard(), StopSignals() as stop:
        _require_ros()
        from soter.adapters.ros2.simulator import Ros2Simulator
        from soter.sdk import RuleLimits

        room, specs = sim.room_and_robots(workspace, robots, seed)
        limits = RuleLimits(separation, clearance)
        opened = Ros2Simulator(room, specs, stamped=stamped, domain_id=domain, truth_port=truth, limits=limits)
        with closing(opened) as simulator:
            _say_how_to_connect(simulator, stamped=stamped)
            sim.keep(simulator, stop)


_INIT_TIMEOUT_S = 60.0


def _require_ros() -> None:
    """Check ROS 2 before anything starts: rclpy imports the middleware only later, in a callback."""
    from soter.registry import load_backend

    load_backend("ros2")


def _open(mission: MissionFile) -> WireFleet[Any]:
    """Open the robots of a mission for watching; other programs have started them."""
    from soter.adapters.ros2.backend import Ros2Backend
    from soter.adapters.ros2.options import Ros2Config, Ros2RobotOptions
    from soter.config import validate_options
    from soter.specs import asked, robot_specs

    workspace = mission.read_workspace()
    given = mission.backends.get("ros2", {})
    config = validate_options(Ros2Config, given, mission.source, "backends.ros2", {"workspace": workspace})
    assert isinstance(config, Ros2Config)
    robots = config.robots or {place.id: Ros2RobotOptions(namespace=f"/robot{place.id}") for place in workspace.robots}
    config = config.model_copy(update={"robots": robots})
    promised = asked(Ros2Backend, config, mission, workspace)
    return Ros2Backend(external_ac=True).open(config, robot_specs(mission, workspace, promised))


def _say_how_to_connect(simulator: Ros2Simulator, *, stamped: bool) -> None:
    """Print the keys of a mission file and the environment of a terminal that connect to the robots."""
    from soter.adapters.ros2.simulator import SETTINGS

    lines = [
        "[backends.ros2]", f"domain_id = {simulator.domain_id}", f'truth = "{simulator.truth}"',
        "use_sim_time = true", "loopback = true", *(["stamped = true"] if stamped else []),
        *(f'robots.{robot_id}.namespace = "{name}"' for robot_id, name in simulator.namespaces.items()),
    ]  # fmt: skip
    emit("In a mission file:\n\n" + "\n".join(lines))
    settings = {"ROS_DOMAIN_ID": str(simulator.domain_id), **SETTINGS}
    emit("\nIn a terminal, before any other node or ros2 tool:\n")
    emit("\n".join(f"export {name}={value}" for name, value in settings.items()))
    emit("\nCtrl-C ends it.")
