"""The world as robots on keys: `python -m soter_sim.zenoh`, which `soter sim zenoh` and the backend `zenoh` start.

Each robot has a namespace with the keys of a ROS 2 robot's base behind zenoh-bridge-ros2dds: `odom` (nav_msgs/Odometry,
30 Hz), `battery_state` (sensor_msgs/BatteryState, 2 Hz) and `cmd_vel` (geometry_msgs/Twist, or TwistStamped); it stops
0.2 s after the last velocity. The key `clock` in the namespace shows the robot's own time at 60 Hz. The mux in front of
`cmd_vel`, which is started beside it, one process for each robot, decides which controller drives.

The world comes on standard input, as `soter.sdk.wire.describe` writes it. The first line printed is JSON: `{"truth":
"127.0.0.1:PORT", "control": {...}, "endpoints": ["tcp/127.0.0.1:PORT"]}`, the address of `soter_sim.truth_server`, how
to reach `soter_sim.faults`, and where its Zenoh session listens.
"""
