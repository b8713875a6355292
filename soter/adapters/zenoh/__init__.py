"""Robots on Zenoh: ROS 2 robots behind zenoh-bridge-ros2dds, or programs with the same messages."""
