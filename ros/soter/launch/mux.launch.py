"""The mux of one robot, on the robot: `ros2 launch soter mux.launch.py robot:=robot1 cmd_vel:=base/cmd_vel`."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Start the mux, and start it again whenever it ends: while there is none, the base gets no velocities."""
    robot, cmd_vel, v_max = (LaunchConfiguration(name) for name in ("robot", "cmd_vel", "v_max_m_s"))
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="robot1", description="the robot's namespace"),
            DeclareLaunchArgument("cmd_vel", default_value="cmd_vel", description="where its base listens"),
            DeclareLaunchArgument("v_max_m_s", default_value="0.22", description="nothing faster passes"),
            ExecuteProcess(
                cmd=[
                    "soter-ros2-mux", "--robot", robot,
                    "--ros-args", "-r", ["cmd_vel:=", cmd_vel], "-p", ["v_max_m_s:=", v_max],
                ],
                name="soter_mux", output="screen", respawn=True, respawn_delay=0.5,
            ),
        ]
    )  # fmt: skip
