"""Frames: the world is east, north, up from a corner of the workspace; messages have north, east, down or degrees.

In a world in metres the EKF's origin is the workspace's, so that both differ in their axes only. In a world with
geographic positions, metres are those of the ellipsoid. There each EKF has its origin where its vehicle has booted,
metres of ArduPilot's sphere, and true north at the vehicle's place.
"""

from __future__ import annotations

from functools import lru_cache
from math import atan2, cos, nan, pi, radians, remainder, sin
from typing import Final, NamedTuple

from soter.geometry.earth import Projection
from soter.geometry.site import GeoOrigin

_M_PER_E7_DEG: Final = 0.011131884502145034
"""Metres along a meridian per 1e-7 degrees, on ArduPilot's sphere."""


class Origin(NamedTuple):
    """The geographic position of the workspace's origin.

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
            ValueError: the text is no origin, or is too near to a pole for a flat map.
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
            # Take the shorter way round the earth.
            remainder(lon_e7 - self.lon_deg * 1e7, 3.6e9) * _M_PER_E7_DEG * cos(radians(self.lat_deg)),
            (lat_e7 - self.lat_deg * 1e7) * _M_PER_E7_DEG,
        )

    def reckoning(self, x_m: float, y_m: float) -> Reckoning:
        """Return the reckoning of the EKF of a vehicle that boots at a place in the workspace."""
        return Reckoning(self, 0.0, 0.0)

    def reckoning_from(self, x_m: float, y_m: float) -> Reckoning:
        """Return the reckoning of an EKF that has its origin at a place in the workspace."""
        return Reckoning(self, x_m, y_m)


class Globe(Origin):
    """The geographic origin of a world whose metres are those of the ellipsoid."""

    __slots__ = ()

    @property
    def projection(self) -> Projection:
        """Projection from the ellipsoid to the world."""
        return _projection(self.lat_deg, self.lon_deg)

    def geodetic_e7(self, x_m: float, y_m: float) -> tuple[int, int]:
        lat_deg, lon_deg = self.projection.place(x_m, y_m)
        return round(1e7 * lat_deg), round(1e7 * lon_deg)

    def local_m(self, lat_e7: float, lon_e7: float) -> tuple[float, float]:
        return self.projection.point(1e-7 * lat_e7, 1e-7 * lon_e7)

    def reckoning(self, x_m: float, y_m: float) -> Reckoning:
        return GlobeReckoning(self, x_m, y_m)

    def reckoning_from(self, x_m: float, y_m: float) -> Reckoning:
        return GlobeReckoning(self, x_m, y_m)


@lru_cache
def _projection(lat_deg: float, lon_deg: float) -> Projection:
    return Projection(GeoOrigin(lat_deg, lon_deg), "the simulated world")


class Reckoning:
    """Converts places to the frame of an EKF; in a world in metres, the EKF has the world's axes.

    Args:
        origin: the world's geographic origin.
        x_m: the EKF's origin in the world, east.
        y_m: the EKF's origin in the world, north.

    Attributes:
        origin_e7: latitude and longitude of the EKF's origin, in 1e-7 degrees.
    """

    def __init__(self, origin: Origin, x_m: float, y_m: float) -> None:
        self.origin_e7 = origin.geodetic_e7(x_m, y_m)
        # Where those whole numbers are.
        self._x_m, self._y_m = origin.local_m(*self.origin_e7) if x_m or y_m else (0.0, 0.0)

    def local_m(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a place in the world as metres east and north of the EKF's origin."""
        return x_m - self._x_m, y_m - self._y_m

    def world_m(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return the place in the world that is given as metres east and north of the EKF's origin."""
        return east_m + self._x_m, north_m + self._y_m

    def north_rad(self, x_m: float, y_m: float) -> float:
        """Return the angle from the world's north to the EKF's, counter-clockwise, at a place in the world."""
        return 0.0


class GlobeReckoning(Reckoning):
    """Converts places to the frame of an EKF in a world with geographic positions.

    Args:
        globe: the world's geographic origin.
        x_m: the EKF's origin in the world, east.
        y_m: the EKF's origin in the world, north.
    """

    def __init__(self, globe: Globe, x_m: float, y_m: float) -> None:
        self._globe: Final = globe
        self.origin_e7 = globe.geodetic_e7(x_m, y_m)

    def local_m(self, x_m: float, y_m: float) -> tuple[float, float]:
        lat_deg, lon_deg = self._globe.projection.place(x_m, y_m)
        lat_0, lon_0 = self.origin_e7
        d_lat = lat_deg * 1e7 - lat_0
        d_lon = remainder(lon_deg * 1e7 - lon_0, 3.6e9)
        return d_lon * _shrunk_m(lat_0 + 0.5 * d_lat), d_lat * _M_PER_E7_DEG

    def world_m(self, east_m: float, north_m: float) -> tuple[float, float]:
        lat_0, lon_0 = self.origin_e7
        d_lat = north_m / _M_PER_E7_DEG
        return self._globe.local_m(lat_0 + d_lat, lon_0 + east_m / _shrunk_m(lat_0 + 0.5 * d_lat))

    def north_rad(self, x_m: float, y_m: float) -> float:
        projection = self._globe.projection
        lat_deg, lon_deg = projection.place(x_m, y_m)
        # About ten metres north and south of the place.
        x_1, y_1 = projection.point(lat_deg + 1e-4, lon_deg)
        x_0, y_0 = projection.point(lat_deg - 1e-4, lon_deg)
        return atan2(x_0 - x_1, y_1 - y_0)


def _shrunk_m(lat_e7: float) -> float:
    return _M_PER_E7_DEG * cos(radians(1e-7 * lat_e7))


def turned(x: float, y: float, angle_rad: float) -> tuple[float, float]:
    """Turn a vector counter-clockwise."""
    if not angle_rad:
        return x, y
    c, s = cos(angle_rad), sin(angle_rad)
    return x * c - y * s, x * s + y * c


def wrapped_rad(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    return pi - (pi - angle_rad) % (2.0 * pi)


def turned_rad(angle_rad: float) -> float:
    """Turn a heading (counter-clockwise from east) into a yaw (clockwise from north), or back; in (-pi, pi]."""
    return wrapped_rad(0.5 * pi - angle_rad)
