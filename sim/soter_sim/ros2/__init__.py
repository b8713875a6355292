"""The world as ROS 2 robots: `python -m soter_sim.ros2`, which `soter sim ros2` and the backend `ros2` start.

Each robot has a namespace with the topics of a real base: `odom` (nav_msgs/Odometry, 30 Hz), `battery_state`
(sensor_msgs/BatteryState, 2 Hz) and `cmd_vel` (geometry_msgs/Twist, or TwistStamped); it stops 0.2 s after the last
velocity. `/clock` shows the world's time at 60 Hz, and `clock` in the namespace the robot's own, which faults part from
it. SOTER is not part of it: the mux in front of `cmd_vel`, which is started beside it, one process for each robot,
decides which controller drives.

The world comes on standard input, as `soter.sdk.wire.describe` writes it. The first line printed is JSON: `{"truth":
"127.0.0.1:PORT", "control": {...}}`, the address of `soter_sim.truth_server` and how to reach `soter_sim.faults`.
"""
