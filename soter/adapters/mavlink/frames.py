"""Conversion between SOTER's frame, workspace ENU, and the autopilot's frame, NED from the origin of its EKF.

Headings are radians counter-clockwise from east in SOTER, and radians clockwise from north in the autopilot. All
conversions of the adapter go through this module.

A workspace in metres uses the vehicle's metres, which a `Frame` only shifts. A workspace with places on earth has
metres of the ellipsoid, and each vehicle metres of its own sphere: an `EarthFrame` goes through latitude and longitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, cos, degrees, hypot, pi, radians, remainder, sin, tan
from typing import Final, NamedTuple, Protocol

from soter.geometry.earth import Projection

_M_PER_DEG: Final = 0.011131884502145034 * 1e7
"""Metres per degree of latitude, on ArduPilot's model of the earth as a sphere."""

_PX4_M: Final = 6_371_000.0
"""Radius of PX4's model of the earth as a sphere."""

NORTHMOST_DEG: Final = 80.0
"""Latitude, north or south, up to which the stated errors have been tested."""

_WIRE_M: Final = 0.002
_WHOLE_M: Final = 0.016
_SINGLE: Final = 2e-7
_MOVES_S: Final = 1.0


class GeoPoint(NamedTuple):
    """A place on earth, with its height above the sea.

    If it is the origin of a workspace, the workspace's metres are those of ArduPilot's sphere.
    """

    lat_deg: float
    lon_deg: float
    alt_m: float

    def place(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return latitude and longitude of a place in a workspace whose origin is this point."""
        lon_deg = self.lon_deg + x_m / (_M_PER_DEG * cos(radians(self.lat_deg)))
        return self.lat_deg + y_m / _M_PER_DEG, remainder(lon_deg, 360.0)

    def point(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return x and y of a place on earth in a workspace whose origin is this point."""
        frame = Frame.between(self, GeoPoint(lat_deg, lon_deg, self.alt_m), 0.0)
        return frame.east_m, frame.north_m


def geodetic_e7(origin: GeoPoint | Projection, x_m: float, y_m: float) -> tuple[int, int]:
    """Return latitude and longitude, in 1e-7 degrees, of a place in a workspace with this origin.

    They are whole numbers on the wire, so that the place is off by up to 6 mm.
    """
    lat_deg, lon_deg = origin.place(x_m, y_m)
    return round(1e7 * lat_deg), round(1e7 * lon_deg)


def local_m(origin: GeoPoint | Projection, lat_e7: int, lon_e7: int) -> tuple[float, float]:
    """Return x and y, in a workspace with this origin, of a place in 1e-7 degrees."""
    return origin.point(1e-7 * lat_e7, 1e-7 * lon_e7)


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
            workspace: the workspace's origin on earth; None if the workspace has the EKF's origin.
            ekf: the EKF's origin.
            plane_m: height of the workspace's plane z = 0 above its origin: the height at which copters fly.
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

    def to_velocity(self, _at: tuple[float, float], north_m_s: float, east_m_s: float) -> tuple[float, float]:
        """Return the velocity along x and y of a vehicle at a place in the workspace."""
        return east_m_s, north_m_s

    def to_heading_rad(self, _at: tuple[float, float], yaw_rad: float) -> float:
        """Return the heading in the workspace, in (-pi, pi], of a vehicle with a yaw at a place in it."""
        return turned_rad(yaw_rad)

    def to_yaw_rad(self, _at: tuple[float, float], heading_rad: float) -> float:
        """Return the yaw, in (-pi, pi], of a heading at a place in the workspace."""
        return turned_rad(heading_rad)


class Sphere(Protocol):
    """An autopilot's conversion between places on earth and metres from the origin of its EKF."""

    def local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return metres north and east of the EKF's origin."""

    def place(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return latitude and longitude in degrees."""

    def error_m(self, far_m: float, speed_m_s: float, /) -> float:
        """Return how far the autopilot's own result may differ from that of this class.

        Args:
            far_m: the vehicle's largest distance from the EKF's origin.
            speed_m_s: the vehicle's top speed.
        """


@dataclass(frozen=True, slots=True)
class ArduPilotSphere:
    """ArduPilot's sphere: metres of longitude shrink by the cosine of the mean of both latitudes."""

    ekf: GeoPoint

    def local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        east_deg = remainder(lon_deg - self.ekf.lon_deg, 360.0) * cos(radians(0.5 * (lat_deg + self.ekf.lat_deg)))
        return (lat_deg - self.ekf.lat_deg) * _M_PER_DEG, east_deg * _M_PER_DEG

    def place(self, north_m: float, east_m: float) -> tuple[float, float]:
        north_deg, east_deg = north_m / _M_PER_DEG, east_m / _M_PER_DEG
        mean_rad = radians(self.ekf.lat_deg + 0.5 * north_deg)
        return self.ekf.lat_deg + north_deg, remainder(self.ekf.lon_deg + east_deg / cos(mean_rad), 360.0)

    def error_m(self, far_m: float, speed_m_s: float) -> float:
        slope = tan(radians(abs(self.ekf.lat_deg)) + far_m / _PX4_M)
        # ArduPilot works in single precision. Once a second it moves an internal origin to the vehicle, and adds the
        # distance between both origins: metres of longitude at two mean latitudes.
        moves_m = _MOVES_S * speed_m_s * slope * far_m / _PX4_M
        return _WIRE_M + far_m * _SINGLE * (1.0 + slope) + moves_m


@dataclass(frozen=True, slots=True)
class Px4Sphere:
    """PX4's sphere: the azimuthal equidistant projection, true to distance and direction from its origin."""

    ekf: GeoPoint

    def local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        lat, lat_0, lon = radians(lat_deg), radians(self.ekf.lat_deg), radians(lon_deg - self.ekf.lon_deg)
        north = cos(lat_0) * sin(lat) - sin(lat_0) * cos(lat) * cos(lon)
        east = cos(lat) * sin(lon)
        far = hypot(north, east)
        arc = atan2(far, sin(lat_0) * sin(lat) + cos(lat_0) * cos(lat) * cos(lon))
        scale_m = _PX4_M * (arc / far if far > 0.0 else 1.0)
        return north * scale_m, east * scale_m

    def place(self, north_m: float, east_m: float) -> tuple[float, float]:
        far_m, lat_0 = hypot(north_m, east_m), radians(self.ekf.lat_deg)
        if far_m == 0.0:
            return self.ekf.lat_deg, self.ekf.lon_deg
        arc = far_m / _PX4_M
        sin_lat = cos(arc) * sin(lat_0) + north_m / far_m * sin(arc) * cos(lat_0)
        lon = atan2(east_m * sin(arc), far_m * cos(lat_0) * cos(arc) - north_m * sin(lat_0) * sin(arc))
        return degrees(asin(sin_lat)), remainder(self.ekf.lon_deg + degrees(lon), 360.0)

    def error_m(self, far_m: float, _speed_m_s: float) -> float:
        # PX4 truncates the origin that it reports to whole numbers.
        return _WHOLE_M + _WIRE_M + far_m * _SINGLE


@dataclass(frozen=True, slots=True)
class EarthFrame:
    """The frame of a vehicle in a workspace with places on earth.

    Heights are those of the vehicle, along its plumb line; x and y are those of the place on the ellipsoid below it.

    Attributes:
        workspace: the workspace's projection.
        sphere: the vehicle's sphere.
        plane_m: height of the plane z = 0 above the origin of the vehicle's EKF: the height at which copters fly.
    """

    workspace: Projection
    sphere: Sphere
    plane_m: float

    def to_ned(self, x_m: float, y_m: float, z_m: float) -> tuple[float, float, float]:
        """Return north, east and down of the EKF's origin for a place in the workspace."""
        north_m, east_m = self.sphere.local(*self.workspace.place(x_m, y_m))
        return north_m, east_m, -self.plane_m - z_m

    def from_ned(self, north_m: float, east_m: float, down_m: float) -> tuple[float, float, float]:
        """Return x, y and z in the workspace for a place seen from the EKF's origin."""
        x_m, y_m = self.workspace.point(*self.sphere.place(north_m, east_m))
        return x_m, y_m, -self.plane_m - down_m

    def to_velocity(self, at: tuple[float, float], north_m_s: float, east_m_s: float) -> tuple[float, float]:
        """Return the velocity along x and y of a vehicle at a place in the workspace.

        Unlike places, velocities are in metres of the ellipsoid: the vehicle's GPS measures them.
        """
        north, east = self.workspace.axes(*at)
        return north[0] * north_m_s + east[0] * east_m_s, north[1] * north_m_s + east[1] * east_m_s

    def to_heading_rad(self, at: tuple[float, float], yaw_rad: float) -> float:
        """Return the heading in the workspace, in (-pi, pi], of a vehicle with a yaw at a place in it."""
        ahead_x, ahead_y = self.to_velocity(at, cos(yaw_rad), sin(yaw_rad))
        return atan2(ahead_y, ahead_x)

    def to_yaw_rad(self, at: tuple[float, float], heading_rad: float) -> float:
        """Return the yaw, in (-pi, pi], of a heading at a place in the workspace."""
        north, east = self.workspace.axes(*at)
        ahead_x, ahead_y = cos(heading_rad), sin(heading_rad)
        # The axes are perpendicular to within 1e-5 rad even at the end of the largest site: no inverse is needed.
        return atan2(east[0] * ahead_x + east[1] * ahead_y, north[0] * ahead_x + north[1] * ahead_y)


def frame_of(
    workspace: GeoPoint | Projection | None, ekf: GeoPoint, plane_m: float, *, is_px4: bool
) -> Frame | EarthFrame:
    """Return the frame of a vehicle; for the arguments see `Frame.between`. A `Projection` makes an `EarthFrame`."""
    if not isinstance(workspace, Projection):
        return Frame.between(workspace, ekf, plane_m)
    return EarthFrame(workspace, Px4Sphere(ekf) if is_px4 else ArduPilotSphere(ekf), plane_m)
