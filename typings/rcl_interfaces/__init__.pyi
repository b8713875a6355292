"""Messages of ROS 2, as far as they are used here."""
