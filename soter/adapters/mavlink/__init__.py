"""Vehicles on MAVLink: the backends `mavlink`, by pymavlink, and `mavsdk`, by MAVSDK."""

from soter.adapters.mavlink.backend import MavlinkBackend, MavlinkFleet
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.robot import MavlinkRobot

__all__ = [
    "MavlinkBackend",
    "MavlinkConfig",
    "MavlinkFleet",
    "MavlinkRobot",
]
