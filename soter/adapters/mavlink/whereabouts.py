"""Checks in every tick, by a vehicle's own reports, whether it knows where it is.

It does while its EKF says so, its GPS has a fix that is as accurate as before, if it had one at the start, and its
places go on from one to the next.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER
from soter.adapters.mavlink.frames import ArduPilotSphere, GeoPoint
from soter.adapters.mavlink.link import Heard
from soter.adapters.mavlink.vehicle import Vehicle, place_of

logger = logging.getLogger(__name__)

_VARIANCE: Final = 0.8
"""Variance of an EKF's innovations above which ArduPilot's own fail-safe acts after a second."""

_NO_FIX_S: Final = 0.8
"""A GPS without a fix for this time has lost its satellites; ArduPilot, whose GPS has to give five fixes a second,
reports the loss some seconds later."""

_EKF_SILENT_S: Final = 2.0
"""An EKF that has not said for this time whether it knows where it is, while it sends positions, is not trusted."""

_LESS_ACCURATE: Final = 2.0
"""A GPS that is off by so many times what it was at the start is not trusted, unless the options say what it may be."""

_LEAP_M: Final = 1.0
"""A place that is so much farther than the vehicle can have come is told from another origin, or corrects the last."""

_HOME_M: Final = 1.0
"""ArduPilot moves HOME by itself while a vehicle is disarmed, and afterwards no more."""

_FIX: Final = mav.GPS_FIX_TYPE_3D_FIX
_VARIANCES: Final = (
    "velocity_variance", "pos_horiz_variance", "compass_variance", "vel_ratio", "pos_horiz_ratio", "mag_ratio",
)  # fmt: skip
"""ArduPilot's and PX4's names; all are ratios to the largest value that the EKF still accepts."""

_MAY_LACK: Final = "mag_ratio"
"""A PX4 has no figure here while its EKF takes its heading from its motion and from no compass. It is told by its flags
whether it knows where it is, and a heading is trusted by no proof."""


class Whereabouts:
    """Tells whether one vehicle knows where it is. Used in the supervisor's thread.

    Args:
        vehicle: the vehicle.
        v_max_m_s: its promised top speed.
        accuracy_m: how far off its GPS may say that it is; None for twice what it says when it is ready first.

    Attributes:
        astray: why the vehicle's position cannot be trusted; empty while it can.
    """

    def __init__(self, vehicle: Vehicle, v_max_m_s: float, accuracy_m: float | None) -> None:
        self._vehicle: Final = vehicle
        self._v_max_m_s: Final = v_max_m_s
        self._accuracy_m = accuracy_m
        self.astray = ""
        self._had_fix = False
        self._fix: Any = None
        self._fix_s = 0.0
        self._last: Any = None
        self._leapt, self._leapt_s = "", -math.inf
        self._home: GeoPoint | None = None

    def begin(self) -> None:
        """Begin anew with a vehicle that is ready."""
        gps = self._vehicle.inbox.latest.get("GPS_RAW_INT")
        self._had_fix = gps is not None and gps.message.fix_type >= _FIX
        if gps is not None and self._accuracy_m is None:
            self._accuracy_m = _LESS_ACCURATE * _accuracy_m(gps.message) or None
        self._fix, self._fix_s = None, 0.0
        self._last, self._leapt = None, ""
        self._home = None
        self.astray = ""

    def look(self) -> None:
        """Update `astray` by the vehicle's latest messages."""
        position = self._vehicle.inbox.latest["LOCAL_POSITION_NED"]
        self._look_for_leaps(position)
        self._look_at_home()
        self.astray = self._leapt or self._lost_by_ekf(position) or self._lost_by_gps(position)

    def _look_for_leaps(self, position: Heard) -> None:
        """Doubt a place that the vehicle cannot have come to, until it has said since then where its origin is."""
        vehicle, now, last = self._vehicle, position.message, self._last
        self._last = now
        if last is not None and now is not last:
            most_m = _LEAP_M + self._v_max_m_s * max(now.time_boot_ms - last.time_boot_ms, 0) * 1e-3
            leap_m = math.dist((now.x, now.y), (last.x, last.y))
            # Also true for NaN.
            if not leap_m <= most_m:
                self._leapt = f"its place has leapt by {leap_m:.1f} m: the origin of its EKF may have moved"
                self._leapt_s = position.received_s
                vehicle.ask_once(KEEPER, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
        if self._leapt and vehicle.heard_since("GPS_GLOBAL_ORIGIN", self._leapt_s) is not None:
            self._leapt = ""

    def _look_at_home(self) -> None:
        """Warn of a HOME that moves. No rule depends on where it is, but fail-safes that return drive there."""
        heard = self._vehicle.inbox.latest.get("HOME_POSITION")
        if heard is None:
            return
        home, before = place_of(heard.message), self._home
        self._home = home
        moved_m = 0.0 if before is None else math.hypot(*ArduPilotSphere(before).local(home.lat_deg, home.lon_deg))
        if moved_m > _HOME_M:
            logger.warning(
                "robot %d: its HOME has moved by %.1f m, to %.7f, %.7f: a fail-safe of its own that returns goes there",
                self._vehicle.system, moved_m, home.lat_deg, home.lon_deg,
            )  # fmt: skip

    def _lost_by_ekf(self, position: Heard) -> str:
        vehicle = self._vehicle
        # Compared with positions: while the link is silent there is no news of the EKF either.
        since_s = position.received_s - _EKF_SILENT_S
        report = vehicle.ekf_report(since_s)
        if report is None:
            return f"its EKF has not said for {_EKF_SILENT_S:g} s whether it knows where it is"
        if not vehicle.ekf_ready(since_s):
            return "its EKF does not know where it is"
        if report.flags & mav.EKF_GPS_GLITCHING:
            return "its EKF sees its GPS jump"
        for name in _VARIANCES:
            value = getattr(report, name, 0.0)
            # Also true for NaN.
            if not value < _VARIANCE and not (name == _MAY_LACK and math.isnan(value)):
                return f"its EKF does not believe what it measures: {name} is {value:.2f}, allowed: below {_VARIANCE:g}"
        return ""

    def _lost_by_gps(self, position: Heard) -> str:
        gps = self._vehicle.inbox.latest.get("GPS_RAW_INT")
        if gps is None or not self._had_fix:
            return ""
        if gps.message.fix_type < _FIX:
            return f"its GPS has lost its place: fix type {gps.message.fix_type}, allowed: {_FIX} or more"
        accuracy_m, most_m = _accuracy_m(gps.message), self._accuracy_m
        if most_m is not None and accuracy_m > most_m:
            return f"its GPS says that it is off by up to {accuracy_m:.2f} m, allowed: gps_accuracy_m = {most_m:.2f}"
        # By the vehicle's own clock: while the link is silent there is no news of the GPS either.
        stamp_s = position.message.time_boot_ms * 1e-3
        # A PX4 that does not know what time it is sends 0, but sends nothing without a fix.
        fix = gps.message.time_usec or gps.received_s
        if fix != self._fix or stamp_s < self._fix_s:
            self._fix, self._fix_s = fix, stamp_s
        silent_s = stamp_s - self._fix_s
        return "" if silent_s <= _NO_FIX_S else f"its GPS has found no place for {silent_s:.1f} s"


def wait_for_accuracy(vehicle: Vehicle, most_m: float | None) -> Iterator[str]:
    """Wait, step by step, until a GPS is as accurate as the options ask for; yield what is waited for."""
    while most_m is not None and (gps := vehicle.inbox.latest.get("GPS_RAW_INT")) is not None:
        accuracy_m = _accuracy_m(gps.message)
        if accuracy_m <= most_m:
            return
        yield f"its GPS to be as accurate as gps_accuracy_m = {most_m:g}; it says {accuracy_m:.2f} m"


def _accuracy_m(gps: Any) -> float:
    """Return how far off a GPS says that it is; 0 where it does not say."""
    return float(getattr(gps, "h_acc", 0)) * 1e-3
