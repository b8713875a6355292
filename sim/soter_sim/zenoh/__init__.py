"""The world as robots on keys: `python -m soter_sim.zenoh`, which `soter sim zenoh` and the backend `zenoh` start.

Each robot has a namespace and below it the keys that the base of a ROS 2 robot has behind zenoh-bridge-ros2dds: `odom`
(nav_msgs/Odometry, 30 Hz), `battery_state` (sensor_msgs/BatteryState, 2 Hz) and `cmd_vel` (geometry_msgs/Twist, or
TwistStamped), on which it stops 0.2 s after the last message. The key `clock` shows the world's time at 60 Hz. Who may
drive is decided by the mux in front of `cmd_vel`, which is started beside it, one process for each robot.

The world comes as JSON on standard input: a list of `soter.geometry.workspace.Workspace` and of the
`soter.sdk.RobotSpec` of its robots. The first line printed is JSON too: `{"truth": "127.0.0.1:PORT", "endpoints":
["tcp/127.0.0.1:PORT"]}`, where `soter_sim.truth_server` tells what really happens, and where its session listens.
"""
