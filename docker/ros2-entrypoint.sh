#!/bin/bash
# Runs a command where ROS 2 and SOTER's launch files are known.
set -e
source "/opt/ros/$ROS_DISTRO/setup.bash"
source /opt/soter-ros/setup.bash
exec "$@"
