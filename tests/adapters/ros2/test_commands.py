"""The commands, as a user starts them."""

from __future__ import annotations

import json
import signal
import tomllib

import pytest

from tests.adapters.velocity_controlled.processes import EXAMPLES, ctrl_c_ends_a_run, soter
from tests.waiting import wait_until

pytestmark = [pytest.mark.rclpy, pytest.mark.timeout(180)]


def test_a_mission_runs_with_the_same_file_as_everywhere() -> None:
    with soter(
        "run", str(EXAMPLES / "surveillance.toml"), "--backend", "ros2", "--planner", "straight-line",
        "--duration", "4", "--json", "-", "--no-record",
    ) as process:  # fmt: skip
        out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    result = json.loads(out)
    assert result["status"] == "completed"
    assert sum(result["violations"].values()) == 0
    assert result["backend"] == "ros2"


def test_ctrl_c_ends_a_run_and_everything_it_started() -> None:
    ctrl_c_ends_a_run("ros2")


def test_the_simulator_says_how_to_meet_it_and_ends_with_ctrl_c() -> None:
    with soter("sim", "ros2", str(EXAMPLES / "ros2_external_ac" / "hall.xml"), "--robots", "1") as process:
        assert process.stdout is not None
        lines: list[str] = []
        while not lines or not lines[-1].startswith("Ctrl-C"):
            lines.append(process.stdout.readline())
            assert lines[-1], process.communicate()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 0, err
    text = "".join(lines)
    told = tomllib.loads(text[text.index("[backends.ros2]") : text.index("In a terminal")])["backends"]["ros2"]
    assert told["robots"] == {"1": {"namespace": "/robot1"}}
    assert f"export ROS_DOMAIN_ID={told['domain_id']}" in text


def test_a_monitor_without_robots_says_what_is_missing_and_moves_nothing() -> None:
    from soter.adapters.ros2.simulator import Domain

    domain = Domain()
    settings = [f"domain_id={domain.id}", "discovery_s=0.5"]
    with soter(
        "ros2-monitor", str(EXAMPLES / "surveillance.toml"), "--set", "backends.ros2.loopback=true",
        *(part for each in settings for part in ("--set", f"backends.ros2.{each}")),
    ) as process:  # fmt: skip
        _, err = process.communicate(timeout=60)
    domain.close()
    assert process.returncode == 2
    assert "robot 1 at /robot1: within 0.5 s: no node publishes odom" in err


def test_a_signal_ends_the_monitors_wait_for_robots_that_are_not_there() -> None:
    from soter.adapters.ros2.graph import Graph
    from soter.adapters.ros2.simulator import Domain

    domain = Domain()
    graph = Graph(domain.id, use_sim_time=False, on_loopback=True)
    looking = graph.node("/looking")
    settings = ["loopback=true", f"domain_id={domain.id}", "discovery_s=120"]
    with soter(
        "ros2-monitor", str(EXAMPLES / "surveillance.toml"),
        *(part for each in settings for part in ("--set", f"backends.ros2.{each}")),
    ) as process:  # fmt: skip
        # It has begun to look for its robots.
        wait_until(lambda: ("soter", "/robot1") in looking.get_node_names_and_namespaces())
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=20)
    graph.close()
    domain.close()
    assert process.returncode == 143
    assert err.endswith("error: interrupted\n")


def test_the_mux_takes_ros_own_arguments() -> None:
    with soter("ros2-mux", "--robot", "robot1", "--ros-args", "-p", "lease_s:=0.0") as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "parameter lease_s is 0.0, allowed: above 0" in err
