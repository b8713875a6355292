"""Checks, before a vehicle is armed, that its places fit a workspace on earth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.frames import EarthFrame, GeoPoint, frame_of
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.vehicle import RETRY_S, Vehicle
from soter.errors import RobotUnavailable
from soter.geometry.earth import FARTHEST_M
from soter.sdk import Capabilities

_PLACE: Final = "GLOBAL_POSITION_INT"
_ASIDE_M: Final = 0.1
_ASIDE_S: Final = 0.1
_TRIES: Final = 3


def judge_places(vehicle: Vehicle, ekf: GeoPoint, config: MavlinkConfig, promised: Capabilities) -> Iterator[str]:
    """Check a vehicle, step by step; yield what the step waits for. For a workspace in metres nothing is checked.

    Args:
        vehicle: the vehicle, with LOCAL_POSITION_NED heard.
        ekf: the origin of its EKF.
        config: the options, with the workspace.
        promised: the vehicle's top speed and position noise.

    Raises:
        RobotUnavailable: the EKF's origin is too far away, the error of the vehicle's arithmetic alone exceeds the
            promised noise, or its place on earth and its place from the EKF's origin differ.
    """
    frame = frame_of(config.geo_origin, ekf, 0.0, is_px4=vehicle.kind.is_px4)
    if not isinstance(frame, EarthFrame):
        return
    sphere, origin = frame.sphere, frame.workspace.origin
    away_m = math.hypot(*sphere.local(origin.lat_deg, origin.lon_deg))
    if away_m > FARTHEST_M:
        raise RobotUnavailable(
            f"its EKF has its origin {away_m / 1000.0:.0f} km from that of the workspace, allowed: "
            f"{FARTHEST_M / 1000.0:.0f} km"
        )
    low_x, low_y, high_x, high_y = config.workspace.bounds
    x_m, y_m = frame.workspace.point(ekf.lat_deg, ekf.lon_deg)
    far_m = math.hypot(max(x_m - low_x, high_x - x_m), max(y_m - low_y, high_y - y_m))
    error_m = sphere.error_m(far_m, promised.v_max_m_s)
    if promised.position_noise_m < error_m:
        raise RobotUnavailable(
            f"by its arithmetic alone its places are off by up to {error_m:.4f} m, {far_m:.0f} m from the origin of "
            f"its EKF, and promise.position_noise_m is {promised.position_noise_m:g}; allowed: at least that"
        )
    for left in reversed(range(_TRIES)):
        asked_s, due_s = vehicle.now_s, -math.inf
        while (place := vehicle.heard_since(_PLACE, asked_s)) is None:
            if vehicle.now_s >= due_s:
                due_s = vehicle.now_s + RETRY_S
                vehicle.ask_once(KEEPER, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
            yield "its place on earth"
        at = vehicle.inbox.latest["LOCAL_POSITION_NED"].message
        since_s = (at.time_boot_ms - place.time_boot_ms) * 1e-3
        local_m = at.x - at.vx * since_s, at.y - at.vy * since_s
        off_m = math.dist(local_m, sphere.local(place.lat * 1e-7, place.lon * 1e-7))
        if off_m <= _ASIDE_M + _ASIDE_S * math.hypot(at.vx, at.vy):
            return
        if not left:
            raise RobotUnavailable(
                f"its reported place on earth is {off_m:.2f} m from its reported place relative to its EKF's origin, "
                f"allowed at rest: {_ASIDE_M:g} m; it converts places otherwise than its autopilot is known to"
            )
