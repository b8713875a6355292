"""Converts SET_POSITION_TARGET_*, with its frames and masks, to a place or a velocity."""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, sin
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.frames import turned, turned_rad
from soter_sim.mavlink.setpoint import Place, Sample, Velocity

_POSITION: Final = 0x0007
_VELOCITY: Final = 0x0038
_YAW: Final = 0x0400
_YAW_RATE: Final = 0x0800

# Farther than any place on earth, faster than any vehicle.
_ABSURD: Final = 1e8

_RELATIVE_TO_BODY: Final = (mav.MAV_FRAME_BODY_NED, mav.MAV_FRAME_BODY_OFFSET_NED)
_LOCAL: Final = (mav.MAV_FRAME_LOCAL_NED, mav.MAV_FRAME_LOCAL_OFFSET_NED, *_RELATIVE_TO_BODY)
_GLOBAL: Final = (mav.MAV_FRAME_GLOBAL, mav.MAV_FRAME_GLOBAL_INT)
_ABOVE_HOME: Final = (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


class NotATarget(ValueError):
    """A message is no target that the vehicle can take; the error says why."""


def local_target(autopilot: Autopilot, message: mav.MAVLink_message) -> Place | Velocity:
    """Return the target in SET_POSITION_TARGET_LOCAL_NED.

    Raises:
        NotATarget: a number is not finite, or the frame or the mask is not supported.
    """
    frame, at = message.coordinate_frame, autopilot.sample()
    if frame not in _LOCAL:
        raise NotATarget(f"frame {frame} is not supported")
    position = None
    if not message.type_mask & _POSITION:
        _check(message, "x", "y", "z")
        north, east = message.x, message.y
        reckoning = autopilot.reckoning
        if frame == mav.MAV_FRAME_LOCAL_NED:
            position = (*reckoning.world_m(east, north), -message.z)
        else:
            if frame in _RELATIVE_TO_BODY:
                east, north = _from_body(at, north, east)
            else:
                east, north = turned(east, north, reckoning.north_rad(at.x_m, at.y_m))
            position = (at.x_m + east, at.y_m + north, at.z_m - message.z)
    return _target(autopilot, message, at, position, in_body=frame in _RELATIVE_TO_BODY)


def global_target(autopilot: Autopilot, message: mav.MAVLink_message) -> Place | Velocity:
    """Return the target in SET_POSITION_TARGET_GLOBAL_INT.

    Raises:
        NotATarget: a number is not finite, or the frame or the mask is not supported.
    """
    position = None
    if not message.type_mask & _POSITION:
        position = global_place(autopilot, message.coordinate_frame, message.lat_int, message.lon_int, message.alt)
    return _target(autopilot, message, autopilot.sample(), position, in_body=False)


def global_place(
    autopilot: Autopilot, frame: int, lat_e7: float, lon_e7: float, alt_m: float
) -> tuple[float, float, float]:
    """Return a place given in 1e-7 degrees and metres as metres east, north and up.

    Raises:
        NotATarget: the height is not finite, or the frame is not supported.
    """
    # Written so that NaN fails too.
    if not -_ABSURD <= alt_m <= _ABSURD:
        raise NotATarget(f"alt is {alt_m:g}")
    if frame in _GLOBAL:
        up_m = alt_m - autopilot.origin.alt_m
    elif frame in _ABOVE_HOME:
        up_m = alt_m + (0.0 if autopilot.home is None else autopilot.home[2])
    else:
        raise NotATarget(f"frame {frame} is not supported")
    return *autopilot.origin.local_m(lat_e7, lon_e7), up_m


def _target(
    autopilot: Autopilot,
    message: mav.MAVLink_message,
    at: Sample,
    position: tuple[float, float, float] | None,
    *,
    in_body: bool,
) -> Place | Velocity:
    mask, kind = message.type_mask, autopilot.kind
    turned_by_rad = autopilot.reckoning.north_rad(at.x_m, at.y_m)
    velocity = None
    if not mask & _VELOCITY:
        _check(message, "vx", "vy", "vz")
        north, east = message.vx, message.vy
        if in_body:
            east, north = _from_body(at, north, east)
        else:
            east, north = turned(east, north, turned_by_rad)
        velocity = Velocity(east, north, -message.vz)
    heading_rad = yaw_rate_rad_s = None
    if not mask & _YAW:
        _check(message, "yaw")
        heading_rad = turned_rad(message.yaw - turned_by_rad)
    if not mask & _YAW_RATE:
        _check(message, "yaw_rate")
        yaw_rate_rad_s = -message.yaw_rate
    if position is None:
        if velocity is None and heading_rad is not None and yaw_rate_rad_s is None and not kind.flies:
            return Velocity(0.0, 0.0, heading_rad=heading_rad)
        if velocity is None:
            raise NotATarget(f"type mask {mask} asks for neither a position nor a velocity")
        return replace(velocity, yaw_rate_rad_s=yaw_rate_rad_s)
    obeys = not autopilot.plain and autopilot.parameters["SOTER_YAW_SPEED"] > 0.0
    speed_m_s = autopilot.cruise_m_s
    if velocity is not None and obeys:
        wanted_m_s = hypot(velocity.east_m_s, velocity.north_m_s)
        speed_m_s = min(speed_m_s, wanted_m_s) if wanted_m_s > 0.0 else speed_m_s
    x_m, y_m, z_m = position
    return Place(x_m, y_m, z_m if kind.flies else 0.0, heading_rad if obeys or kind.flies else None, speed_m_s)


def _from_body(at: Sample, forward: float, right: float) -> tuple[float, float]:
    """Return a vector, given forward and to the right, as east and north."""
    c, s = cos(at.heading_rad), sin(at.heading_rad)
    return forward * c + right * s, forward * s - right * c


def _check(message: mav.MAVLink_message, *names: str) -> None:
    for name in names:
        value = getattr(message, name)
        # Written so that NaN fails too.
        if not -_ABSURD <= value <= _ABSURD:
            raise NotATarget(f"{name} is {value:g}")
