"""ROS 2 robots: the backend `ros2`, and the mux that runs on each robot.

Nothing is imported here, so that the mux starts on a robot with rclpy, the messages and the standard library only.

Each robot has a namespace. SOTER uses these topics in it, all of standard types, and all can be remapped:

| topic | type | publisher | content |
|---|---|---|---|
| `odom` | nav_msgs/Odometry | robot | pose and velocity, with the robot's time |
| `battery_state` | sensor_msgs/BatteryState | robot | its charge |
| `cmd_vel_ac` | geometry_msgs/Twist (or TwistStamped) | the AC | the AC's velocity |
| `cmd_vel_sc` | the same | SOTER | the safe controller's velocity |
| `cmd_vel` | the same | mux | the active controller's velocity, or rest |
| `soter/order` | std_msgs/String, latched | SOTER | the active controller, and the lease: `wire.Order` |
| `soter/gate` | std_msgs/String, latched | mux | the mux's state: `wire.GateReport` |
"""
