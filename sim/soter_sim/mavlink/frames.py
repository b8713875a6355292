"""Frames: the world is east, north, up from a corner of the workspace; on the wire it is north, east, down or degrees.

The origin of the EKF is the origin of the workspace, so that both differ by their axes only.
"""

from __future__ import annotations

from math import cos, nan, pi, radians, remainder
from typing import Final, NamedTuple

_M_PER_E7_DEG: Final = 0.011131884502145034
"""Metres along a meridian by 1e-7 degrees, on the sphere that ArduPilot takes the earth for."""


class Origin(NamedTuple):
    """Where on earth the workspace has its origin.

    Attributes:
        lat_deg: degrees north.
        lon_deg: degrees east.
        alt_m: metres above the sea.
    """

    lat_deg: float = 47.397742
    lon_deg: float = 8.545594
    alt_m: float = 488.0

    @staticmethod
    def read(text: str) -> Origin:
        """Read an origin from "LATITUDE,LONGITUDE,ALTITUDE", in degrees and metres.

        Raises:
            ValueError: it is none, or nearer to a pole than any map of right angles can be.
        """
        try:
            origin = Origin(*map(float, text.split(",")))
        except (ValueError, TypeError):
            origin = Origin(nan, nan, nan)
        # Written so that NaN fails too.
        if not (abs(origin.lat_deg) <= 85.0 and abs(origin.lon_deg) <= 180.0 and abs(origin.alt_m) <= 1e4):
            raise ValueError(
                f"origin is '{text}', allowed: LATITUDE,LONGITUDE,ALTITUDE in degrees and metres, the latitude from "
                "-85 to 85, such as 47.397742,8.545594,488"
            )
        return origin

    def geodetic_e7(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return latitude and longitude, in 1e-7 degrees, of a place in the workspace."""
        return (
            round(self.lat_deg * 1e7 + y_m / _M_PER_E7_DEG),
            round(self.lon_deg * 1e7 + x_m / (_M_PER_E7_DEG * cos(radians(self.lat_deg)))),
        )

    def local_m(self, lat_e7: float, lon_e7: float) -> tuple[float, float]:
        """Return metres east and north, in the workspace, of a place given in 1e-7 degrees."""
        return (
            # The shorter way round the earth.
            remainder(lon_e7 - self.lon_deg * 1e7, 3.6e9) * _M_PER_E7_DEG * cos(radians(self.lat_deg)),
            (lat_e7 - self.lat_deg * 1e7) * _M_PER_E7_DEG,
        )


def wrapped_rad(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    return pi - (pi - angle_rad) % (2.0 * pi)


def turned_rad(angle_rad: float) -> float:
    """Turn a heading (counter-clockwise from east) into a yaw (clockwise from north), or back; in (-pi, pi]."""
    return wrapped_rad(0.5 * pi - angle_rad)
