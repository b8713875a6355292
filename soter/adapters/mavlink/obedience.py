"""Checks in every tick, by a vehicle's own reports, whether it obeys and whether it knows where it is.

That a command was sent proves nothing. A vehicle obeys while it is armed, it is in the mode that takes targets, no
fail-safe of its own acts, its target is a place that was sent here, and its parameters allow the promise. It knows
where it is while its EKF says so, and its GPS has a fix, if it had one at the start.
"""

from __future__ import annotations

import math
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import ArduPilotSphere, GeoPoint
from soter.adapters.mavlink.parameters import JudgedParameters
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import Vehicle

_VARIANCE: Final = 0.8
"""Variance of an EKF's innovations above which ArduPilot's own fail-safe acts after a second."""

_NO_FIX_S: Final = 0.8
"""A GPS without a fix for this time has lost its satellites; ArduPilot, whose GPS has to give five fixes a second,
reports the loss some seconds later."""

_EKF_SILENT_S: Final = 2.0
"""An EKF that has not said for this time whether it knows where it is, while it sends positions, is not trusted."""

_TOOK_S: Final = 5.0
"""A vehicle that leaves its mode within this time after a failure has done so by itself; else a person changed it."""

_GONE_S: Final = 1.0

_ELSEWHERE_M: Final = 1.0
"""A target this far from all sent places is another ground station's. Autopilots report places to a centimetre."""

_TARGET: Final = "POSITION_TARGET_GLOBAL_INT"
_FIX: Final = mav.GPS_FIX_TYPE_3D_FIX
_ACTS: Final = frozenset({mav.MAV_STATE_CRITICAL, mav.MAV_STATE_EMERGENCY, mav.MAV_STATE_FLIGHT_TERMINATION})
_VARIANCES: Final = (
    "velocity_variance", "pos_horiz_variance", "compass_variance", "vel_ratio", "pos_horiz_ratio", "mag_ratio",
)  # fmt: skip
"""ArduPilot's and PX4's names; all are ratios to the largest value that the EKF still accepts."""

_MAY_LACK: Final = "mag_ratio"
"""A PX4 has no figure here while its EKF takes its heading from its motion and from no compass. It is told by its flags
whether it knows where it is, and a heading is trusted by no proof."""


class Obedience:
    """Tells whether one vehicle obeys and knows where it is. Used in the supervisor's thread.

    Attributes:
        origin: the origin of the vehicle's EKF; None for a vehicle whose target is not watched.
        astray: why the vehicle's position cannot be trusted; empty while it can.
        disobeys: what the vehicle does instead of obeying; empty while it obeys.
    """

    def __init__(self, vehicle: Vehicle, setpoints: Setpoints, judged: JudgedParameters) -> None:
        self._vehicle: Final = vehicle
        self._setpoints: Final = setpoints
        self._judged: Final = judged
        self._gated = False
        self.origin: GeoPoint | None = None
        self.astray = self.disobeys = ""
        self._had_fix = False
        self._fix: Any = None
        self._fix_s, self._failed_s = 0.0, -math.inf
        self._looked_s, self._led_s = 0.0, -math.inf
        self._led = ""
        self._by_itself = False

    def begin(self, origin: GeoPoint, *, gated: bool) -> None:
        """Begin anew with a vehicle that is ready.

        Args:
            origin: the origin of the vehicle's EKF.
            gated: whether the vehicle has a gate of its own: then targets and parameters of others are no concern.
        """
        self._gated = gated
        self.origin = None if gated or self._vehicle.kind.is_px4 else origin
        self._looked_s, self._led_s = self._vehicle.now_s, -math.inf
        gps = self._vehicle.inbox.latest.get("GPS_RAW_INT")
        self._had_fix = gps is not None and gps.message.fix_type >= _FIX
        self._fix, self._fix_s, self._failed_s = None, 0.0, -math.inf
        self._by_itself = False
        self.astray = self.disobeys = ""

    def look(self) -> None:
        """Update `astray` and `disobeys` by the vehicle's latest messages."""
        vehicle = self._vehicle
        now_s = vehicle.now_s
        self.astray = self._lost_its_way()
        heartbeat = vehicle.heartbeat
        failsafe = heartbeat is not None and heartbeat.system_status in _ACTS
        if self.astray or failsafe or heartbeat is None:
            self._failed_s = now_s
        obeyed = not self.disobeys
        self.disobeys = self._instead(failsafe=failsafe)
        if obeyed and self.disobeys:
            self._by_itself = now_s - self._failed_s <= _TOOK_S

    def look_for_place(self) -> None:
        """Update `astray` alone, for a vehicle that is made ready again, which may take much longer."""
        self.astray = self._lost_its_way()

    @property
    def may_be_taken_back(self) -> bool:
        """Whether the vehicle left its mode by itself, and the cause is gone. What a pilot took stays the pilot's."""
        gone = self._vehicle.now_s - self._failed_s > _GONE_S
        return bool(self.disobeys) and self._by_itself and gone

    def _instead(self, *, failsafe: bool) -> str:
        vehicle = self._vehicle
        if vehicle.heartbeat is None:
            return "it is not heard"
        if vehicle.mode != vehicle.kind.guided:
            mode = vehicle.kind.mode_name(vehicle.mode or 0)
            return f"it is in the mode {mode}, not {vehicle.kind.mode_name(vehicle.kind.guided)}"
        if not vehicle.armed:
            return "it is disarmed"
        if failsafe:
            return "its own fail-safe acts"
        if not self._gated:
            self._judged.ask_again()
        return self._led_elsewhere() or ("" if self._gated else self._judged.why_refused())

    def _led_elsewhere(self) -> str:
        """Return a message if the vehicle drives to another's target, until a second after its last report of one."""
        now_s = self._vehicle.now_s
        target = None if self.origin is None else self._vehicle.heard_since(_TARGET, self._looked_s)
        self._looked_s = now_s
        if target is not None and self.origin is not None:
            place = ArduPilotSphere(self.origin).local(target.lat_int * 1e-7, target.lon_int * 1e-7)
            off_m = self._setpoints.off_m(*place)
            if off_m > _ELSEWHERE_M:
                self._led_s = now_s
                self._led = f"another ground station sends it elsewhere, {off_m:.1f} m from where it was sent here"
        return self._led if now_s - self._led_s <= _GONE_S else ""

    def _lost_its_way(self) -> str:
        vehicle = self._vehicle
        position = vehicle.inbox.latest["LOCAL_POSITION_NED"]
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
        gps = vehicle.inbox.latest.get("GPS_RAW_INT")
        if gps is None or not self._had_fix:
            return ""
        if gps.message.fix_type < _FIX:
            return f"its GPS has lost its place: fix type {gps.message.fix_type}, allowed: {_FIX} or more"
        # By the vehicle's own clock: while the link is silent there is no news of the GPS either.
        stamp_s = position.message.time_boot_ms * 1e-3
        # A PX4 that does not know what time it is sends 0, but sends nothing without a fix.
        fix = gps.message.time_usec or gps.received_s
        if fix != self._fix or stamp_s < self._fix_s:
            self._fix, self._fix_s = fix, stamp_s
        silent_s = stamp_s - self._fix_s
        return "" if silent_s <= _NO_FIX_S else f"its GPS has found no place for {silent_s:.1f} s"
