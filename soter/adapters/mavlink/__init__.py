"""Vehicles on MAVLink: the backends `mavlink`, by pymavlink, and `mavsdk`, by MAVSDK."""

from soter.adapters.mavlink.backend import MavlinkBackend
from soter.adapters.mavlink.options import MavlinkConfig

__all__ = [
    "MavlinkBackend",
    "MavlinkConfig",
]
