"""Run a mission on ROS 2 robots: `ros2 launch soter run.launch.py mission:=/path/to/mission.toml duration:=60`."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, Shutdown
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Run the mission to its end, with which the launch ends too."""
    mission, duration = LaunchConfiguration("mission"), LaunchConfiguration("duration")
    return LaunchDescription(
        [
            DeclareLaunchArgument("mission", description="the mission file"),
            DeclareLaunchArgument("duration", default_value="600", description="how long, in seconds"),
            ExecuteProcess(
                cmd=["soter", "run", mission, "--backend", "ros2", "--duration", duration],
                name="soter", output="screen", on_exit=Shutdown(reason="the mission has ended"),
                sigterm_timeout="30",  # robots are stopped one after the other
            ),
        ]
    )  # fmt: skip
