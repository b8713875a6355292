"""Frames: SOTER's is east, north, up of the workspace; the autopilot's is north, east, down of its EKF's origin.

Headings are radians counter-clockwise from east here and radians clockwise from north there. All conversions of the
adapter go through this module.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, remainder
from typing import Final, NamedTuple

_M_PER_DEG: Final = 0.011131884502145034 * 1e7
"""Metres along a meridian by degree, on the sphere that ArduPilot takes the earth for."""


class GeoPoint(NamedTuple):
    """A place on earth; its height is above the sea."""

    lat_deg: float
    lon_deg: float
    alt_m: float


def geodetic_e7(origin: GeoPoint, x_m: float, y_m: float) -> tuple[int, int]:
    """Return latitude and longitude, in 1e-7 degrees, of a place in a workspace with its origin there.

    They are whole numbers on the wire: the place is off by up to 6 mm.
    """
    east_m_per_deg = _M_PER_DEG * cos(radians(origin.lat_deg))
    lon_deg = origin.lon_deg + x_m / east_m_per_deg
    return round(1e7 * (origin.lat_deg + y_m / _M_PER_DEG)), round(1e7 * remainder(lon_deg, 360.0))


def local_m(origin: GeoPoint, lat_e7: int, lon_e7: int) -> tuple[float, float]:
    """Return x and y, in a workspace with its origin there, of a place in 1e-7 degrees."""
    east = Frame.between(origin, GeoPoint(1e-7 * lat_e7, 1e-7 * lon_e7, origin.alt_m), 0.0)
    return east.east_m, east.north_m


def wrapped_rad(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    return pi - (pi - angle_rad) % (2.0 * pi)


def turned_rad(angle_rad: float) -> float:
    """Turn a heading (counter-clockwise from east) into a yaw (clockwise from north), or back; in (-pi, pi]."""
    return wrapped_rad(0.5 * pi - angle_rad)


@dataclass(frozen=True, slots=True)
class Frame:
    """Where the origin of a vehicle's EKF is in the workspace. Metres.

    Attributes:
        east_m: east of the workspace's origin.
        north_m: north of it.
        up_m: above its plane z = 0.
    """

    east_m: float = 0.0
    north_m: float = 0.0
    up_m: float = 0.0

    @staticmethod
    def between(workspace: GeoPoint | None, ekf: GeoPoint, plane_m: float) -> Frame:
        """Return the frame of a vehicle.

        Args:
            workspace: where the workspace's origin is on earth; None where the EKF has it.
            ekf: where the EKF has its origin.
            plane_m: how high the plane z = 0 of the workspace lies above its origin: the height at which copters fly.
        """
        if workspace is None:
            return Frame(up_m=-plane_m)
        return Frame(
            # The shorter way round the earth.
            remainder(ekf.lon_deg - workspace.lon_deg, 360.0) * _M_PER_DEG * cos(radians(workspace.lat_deg)),
            (ekf.lat_deg - workspace.lat_deg) * _M_PER_DEG,
            ekf.alt_m - workspace.alt_m - plane_m,
        )

    def to_ned(self, x_m: float, y_m: float, z_m: float) -> tuple[float, float, float]:
        """Return north, east and down of the EKF's origin for a place in the workspace."""
        return y_m - self.north_m, x_m - self.east_m, self.up_m - z_m

    def from_ned(self, north_m: float, east_m: float, down_m: float) -> tuple[float, float, float]:
        """Return x, y and z in the workspace for a place seen from the EKF's origin."""
        return east_m + self.east_m, north_m + self.north_m, self.up_m - down_m
