"""Watch over robots that other nodes drive: `ros2 launch soter monitor.launch.py mission:=/path/to/mission.toml`."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, Shutdown
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Start the monitor; when it ends, so does the launch, and the muxes stop their robots."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("mission", description="the mission file; only its safety modules are run"),
            ExecuteProcess(
                cmd=["soter", "ros2-monitor", LaunchConfiguration("mission")],
                name="soter_monitor", output="screen", on_exit=Shutdown(reason="the monitor has ended"),
                sigterm_timeout="30",  # robots are stopped one after the other
            ),
        ]
    )  # fmt: skip
