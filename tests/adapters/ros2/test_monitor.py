"""A node that knows no SOTER drives two robots into each other and out of the hall; or it tries to."""

from __future__ import annotations

import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from soter.adapters.velocity_controlled.robot import wait_for
from soter.geometry.workspace_xml import read_workspace
from soter.sdk import RobotSpec, TruthReport

pytestmark = [pytest.mark.rclpy, pytest.mark.timeout(180)]

EXAMPLE = Path(__file__).parents[3] / "examples" / "ros2_external_ac"
LONGEST_S = 120.0
NEAR_M = 0.5


def near_everything(report: TruthReport) -> bool:
    """Whether the robots have been near to each other, and to the fence, or beyond."""
    return report.min_margin["collision"] < NEAR_M and report.min_margin["geofence"] < NEAR_M


def all_broken(report: TruthReport) -> bool:
    """Whether the robots have run into each other and out of the hall."""
    return {each.rule for each in report.violations} == {"collision", "geofence"}


def let_it_drive(
    enough: Callable[[TruthReport], bool], folder: Path, *options: str
) -> tuple[TruthReport, dict[str, list[str]]]:
    """Let the example's node drive, watched over, until it is enough.

    Returns:
        What happened, and what was told on the ROS graph.
    """
    from diagnostic_msgs.msg import DiagnosticArray
    from std_msgs.msg import Float64, String

    from soter.adapters.ros2.graph import LATCHED, SENSOR, Graph
    from soter.adapters.ros2.simulator import Ros2Simulator, environment
    from soter.clock import VehicleClock
    from soter.sdk.truth import StreamedTruth

    hall = read_workspace(EXAMPLE / "hall.xml")
    # Nearer to each other, and for a shorter time: it breaks the same rules earlier. They meet after 3 s, and the first
    # seconds may pass before all have found each other on the graph.
    specs = [
        RobotSpec(place.id, 0.5 * (place.x_m + 0.5 * hall.width_m), place.y_m, place.heading_rad)
        for place in hall.robots
    ]
    reckless = folder / "reckless.py"
    reckless.write_text((EXAMPLE / "reckless.py").read_text().replace("% 40.0 < 15.0", "% 25.0 < 9.0"))
    told: defaultdict[str, list[str]] = defaultdict(list)
    with ExitStack() as stack:
        simulator = Ros2Simulator(hall, specs)
        stack.callback(simulator.close)
        truth = StreamedTruth(simulator.truth, VehicleClock())
        stack.callback(truth.close)
        graph = Graph(simulator.domain_id, use_sim_time=False, on_loopback=True)
        stack.callback(graph.close)
        node = graph.node("/listening")
        node.create_subscription(String, "/robot1/soter/mode", lambda each: told["mode"].append(each.data), LATCHED)
        for name in ("robot1", "robot2"):
            node.create_subscription(
                Float64, f"/{name}/soter/margin/geofence", lambda each: told["margin"].append(str(each.data)), SENSOR
            )
        node.create_subscription(
            DiagnosticArray, "/robot1/soter/disengagements",
            lambda each: told["disengagements"].append(each.status[0].message), LATCHED,
        )  # fmt: skip
        node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda each: told["diagnostics"].append(each.status[0].name), 10
        )
        env = {**environment(), "ROS_DOMAIN_ID": str(simulator.domain_id), "PYTHONPATH": ":".join(sys.path)}
        settings = [f"domain_id={simulator.domain_id}", f'truth="{simulator.truth}"']
        watching = start(
            stack, env, "-m", "soter.cli", "ros2-monitor", str(EXAMPLE / "mission.toml"), *options,
            *(part for each in settings for part in ("--set", f"backends.ros2.{each}")),
        )  # fmt: skip
        assert wait_for(lambda: "AC" in told["mode"], 30.0)
        start(stack, env, str(reckless))
        assert wait_for(lambda: enough(truth.report()), LONGEST_S), truth.report().min_margin
        # What has begun by now is seen to its end.
        time.sleep(3.0)
        assert watching.poll() is None
        return truth.report(), told


def start(stack: ExitStack, env: dict[str, str], *arguments: str) -> subprocess.Popen[bytes]:
    process = subprocess.Popen([sys.executable, *arguments], env=env)
    stack.callback(process.wait, 10.0)
    stack.callback(process.terminate)
    return process


def test_watched_over_it_breaks_nothing(tmp_path: Path) -> None:
    report, told = let_it_drive(near_everything, tmp_path)
    assert report.violations == ()
    assert report.contacts == 0
    assert {"AC", "SC"} <= set(told["mode"])
    assert any("margin" in each for each in told["disengagements"])
    assert min(map(float, told["margin"])) < NEAR_M
    assert {"soter: robot1", "soter: robot2"} <= set(told["diagnostics"])


def test_without_its_modules_everything_breaks(tmp_path: Path) -> None:
    report, told = let_it_drive(all_broken, tmp_path, "--no-rta")
    assert report.contacts > 0
    assert set(told["mode"]) == {"AC"}
