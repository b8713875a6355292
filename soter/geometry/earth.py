"""Projects geographic positions to metres: WGS 84 to local east and north around an origin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, TypeGuard

from soter.errors import ConfigError
from soter.geometry.site import GeoOrigin
from soter.geometry.workspace import Point

FARTHEST_M: Final = 28_300.0
"""Distance from the origin to the corner of the largest site.

There, a distance on the tangent plane is less than on the ellipsoid by at most 0.1 m. The error grows with the cube of
the distance: 4 mm at 10 km, negligible at 1 km.
"""


class Projection:
    """East and north on the plane that touches the ellipsoid at an origin.

    Raises:
        ConfigError: the library is not installed.
    """

    def __init__(self, origin: GeoOrigin, source: str) -> None:
        try:
            from pymap3d import Ellipsoid, geodetic2ecef, geodetic2enu  # type: ignore[import-untyped]
        except ImportError as failure:
            raise ConfigError(
                f"places on earth need pymap3d, which cannot be imported ({failure}); install it with "
                "pip install pymap3d",
                source=source,
            ) from failure
        self.origin: Final = origin
        self._to_plane: Final = geodetic2enu
        wgs84 = Ellipsoid.from_name("wgs84")
        self._lengths_m: Final = (wgs84.semimajor_axis, wgs84.semimajor_axis, wgs84.semiminor_axis)
        self._touches_m: Final = tuple(map(float, geodetic2ecef(float(origin.lat_deg), float(origin.lon_deg), 0.0)))
        lat_rad, lon_rad = math.radians(origin.lat_deg), math.radians(origin.lon_deg)
        (sin_lat, cos_lat), (sin_lon, cos_lon) = ((math.sin(a), math.cos(a)) for a in (lat_rad, lon_rad))
        self._east: Final = (-sin_lon, cos_lon, 0.0)
        self._north: Final = (-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
        self._up: Final = (cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)

    def point(self, lat_deg: float, lon_deg: float) -> Point:
        """Return east and north in metres of a place on the ellipsoid.

        Places on the other half of the earth lie below those of this one; they are shown as far away as they are.
        """
        # Given integers, the library would compute with the smallest float type that holds them.
        lat_deg, lon_deg = float(lat_deg), float(lon_deg)
        east, north, up = map(
            float, self._to_plane(lat_deg, lon_deg, 0.0, self.origin.lat_deg, self.origin.lon_deg, 0.0)
        )
        if up > -self._lengths_m[-1]:
            return east, north
        aside_m, away_m = math.hypot(east, north), math.hypot(east, north, up)
        return (east * away_m / aside_m, north * away_m / aside_m) if aside_m > 0.0 else (away_m, 0.0)

    def place(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return latitude and longitude in degrees of the place on the ellipsoid below or above a point."""
        # Intersect the vertical line through the point with the ellipsoid, scaled by its axes: a quadratic equation.
        at = [
            (o + x_m * e + y_m * n) / length
            for o, e, n, length in zip(self._touches_m, self._east, self._north, self._lengths_m, strict=True)
        ]
        up = [u / length for u, length in zip(self._up, self._lengths_m, strict=True)]
        square, half = math.fsum(u * u for u in up), math.fsum(a * u for a, u in zip(at, up, strict=True))
        rest = math.fsum(a * a for a in at) - 1.0
        up_m = -rest / (half + math.sqrt(half * half - square * rest))
        x, y, z = (a + up_m * u for a, u in zip(at, up, strict=True))
        (long_m, _, short_m) = self._lengths_m
        return math.degrees(math.atan2(z * long_m, math.hypot(x, y) * short_m)), math.degrees(math.atan2(y, x))

    def axes(self, x_m: float, y_m: float) -> tuple[Point, Point]:
        """Return one metre north and one metre east on the ellipsoid, at a point, as vectors on the plane.

        Meridians converge: away from the origin, true north is not the plane's north.
        """
        lat_deg, lon_deg = self.place(x_m, y_m)
        lat_rad, lon_rad = math.radians(lat_deg), math.radians(lon_deg - self.origin.lon_deg)
        sin_lat, sin_lon, cos_lon = math.sin(lat_rad), math.sin(lon_rad), math.cos(lon_rad)
        sin_0, cos_0 = self._up[2], self._north[2]
        north = (-sin_lat * sin_lon, sin_0 * sin_lat * cos_lon + cos_0 * math.cos(lat_rad))
        return north, (cos_lon, sin_0 * sin_lon)


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value from a file is a number; `true` is not, although Python counts it as 1."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def check_degrees(name: str, lat_deg: object, lon_deg: object) -> str:
    """Return what is wrong with a latitude and a longitude; empty if nothing is."""
    if not is_number(lat_deg) or not is_number(lon_deg):
        return f"{name} is {lat_deg!r}, {lon_deg!r}, allowed: latitude and longitude as numbers of degrees"
    if not (math.isfinite(lat_deg) and math.isfinite(lon_deg)):
        return f"latitude {lat_deg:g}, longitude {lon_deg:g}; allowed: finite numbers of degrees"
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        hint = "metres of a projection are not read" if max(abs(lat_deg), abs(lon_deg)) > 360.0 else "are they swapped?"
        return (
            f"latitude {lat_deg:g}, longitude {lon_deg:g}; allowed: WGS 84 in degrees, latitude within +-90 and "
            f"longitude within +-180; {hint}"
        )
    return ""


def middle_of(places: Iterable[Sequence[float]]) -> GeoOrigin:
    """Return the middle of places, given as latitude and longitude, to the seventh decimal, about a centimetre."""
    known = list(places)
    lats, lons = [lat for lat, _ in known], [lon for _, lon in known]
    if max(lons) - min(lons) > 180.0:  # they lie on both sides of the meridian at which longitudes end
        lons = [lon % 360.0 for lon in lons]
    middle_deg = math.remainder(round((min(lons) + max(lons)) / 2.0, 7), 360.0)
    return GeoOrigin(round((min(lats) + max(lats)) / 2.0, 7), middle_deg)
