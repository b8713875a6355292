"""ROS 2 robots: the backend `ros2`, and the mux that runs on each robot.

Nothing is imported here, so that the mux starts on a robot with rclpy, the messages and the standard library only.

A robot is a namespace. In it SOTER uses these topics, all of standard types, all of which can be remapped:

| topic | type | who publishes | what it says |
|---|---|---|---|
| `odom` | nav_msgs/Odometry | robot | where it is, at its own time |
| `battery_state` | sensor_msgs/BatteryState | robot | its charge |
| `cmd_vel_ac` | geometry_msgs/Twist (or TwistStamped) | the AC | the velocity that it asks for |
| `cmd_vel_sc` | the same | SOTER | the velocity that its safe controller asks for |
| `cmd_vel` | the same | mux | the one of the two that passes, or rest |
| `soter/order` | std_msgs/String, latched | SOTER | who is in charge, and the lease: `wire.Order` |
| `soter/gate` | std_msgs/String, latched | mux | what the mux makes of it: `wire.GateReport` |
"""
