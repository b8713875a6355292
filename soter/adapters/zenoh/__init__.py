"""Robots on Zenoh: ROS 2 robots behind zenoh-bridge-ros2dds, or whatever speaks as they do."""
