"""Checks in every tick, by a vehicle's own reports, whether it obeys.

That a command was sent proves nothing. A vehicle obeys while it is armed, it is in the mode that takes targets, no
fail-safe of its own acts, its target is a place that was sent here, and its parameters allow the promise.
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import ArduPilotSphere, GeoPoint
from soter.adapters.mavlink.parameters import JudgedParameters
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import Vehicle
from soter.adapters.mavlink.whereabouts import Whereabouts

_TOOK_S: Final = 5.0
"""A vehicle that leaves its mode within this time after a failure has done so by itself; else a person changed it."""

_GONE_S: Final = 1.0

_RESTS_S: Final = 1.0
"""A copter that has held out against the places of another is itself again after such a rest."""

_ELSEWHERE_M: Final = 1.0
"""A target this far from all sent places is another ground station's. Autopilots report places to a centimetre."""

_TARGET: Final = "POSITION_TARGET_GLOBAL_INT"
_ACTS: Final = frozenset({mav.MAV_STATE_CRITICAL, mav.MAV_STATE_EMERGENCY, mav.MAV_STATE_FLIGHT_TERMINATION})


class Obedience:
    """Tells whether one vehicle obeys. Used in the supervisor's thread.

    Args:
        vehicle: the vehicle.
        whereabouts: whether it knows where it is.
        setpoints: where it was sent.
        judged: whether its parameters allow the promise.
        moving_m_s: what a vehicle may show at rest.

    Attributes:
        origin: the origin of the vehicle's EKF; None for a vehicle whose target is not watched.
        disobeys: what the vehicle does instead of obeying; empty while it obeys.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        whereabouts: Whereabouts,
        setpoints: Setpoints,
        judged: JudgedParameters,
        moving_m_s: float,
    ) -> None:
        self._vehicle: Final = vehicle
        self._whereabouts: Final = whereabouts
        self._setpoints: Final = setpoints
        self._judged: Final = judged
        self._moving_m_s: Final = moving_m_s
        self._gated = False
        self.origin: GeoPoint | None = None
        self.disobeys = ""
        self._failed_s = -math.inf
        self._looked_s, self._led_s, self._moved_s = 0.0, -math.inf, -math.inf
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
        self._looked_s, self._led_s, self._led = self._vehicle.now_s, -math.inf, ""
        self._failed_s = -math.inf
        self._by_itself = False
        self.disobeys = ""

    def look(self) -> None:
        """Update `disobeys` by the vehicle's latest messages, after its whereabouts."""
        vehicle = self._vehicle
        now_s = vehicle.now_s
        heartbeat = vehicle.heartbeat
        failsafe = heartbeat is not None and heartbeat.system_status in _ACTS
        if self._whereabouts.astray or failsafe or heartbeat is None:
            self._failed_s = now_s
        obeyed = not self.disobeys
        self.disobeys = self._instead(failsafe=failsafe)
        if obeyed and self.disobeys:
            self._by_itself = now_s - self._failed_s <= _TOOK_S

    @property
    def may_be_taken_back(self) -> bool:
        """Whether the vehicle left its mode by itself, and the cause is gone. What a pilot took stays the pilot's."""
        gone = self._vehicle.now_s - self._failed_s > _GONE_S
        return bool(self.disobeys) and self._by_itself and gone

    @property
    def led(self) -> bool:
        """Whether another ground station sends it places, or did so until just now."""
        return bool(self._led)

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
        """Return a message if the vehicle drives to another's target, until a second after its last report of one.

        A copter has to have come to rest by then, too.
        """
        now_s = self._vehicle.now_s
        target = None if self.origin is None else self._vehicle.heard_since(_TARGET, self._looked_s)
        self._looked_s = now_s
        if target is not None and self.origin is not None:
            place = ArduPilotSphere(self.origin).local(target.lat_int * 1e-7, target.lon_int * 1e-7)
            off_m = self._setpoints.off_m(*place)
            # A boat is held at a place that its autopilot has chosen.
            if off_m > _ELSEWHERE_M + self._judged.drift_m:
                self._led_s = self._moved_s = now_s
                self._led = f"another ground station sends it elsewhere, {off_m:.1f} m from where it was sent here"
        if self._led and now_s - self._led_s > _GONE_S:
            self._led = self._swings(now_s)
        return self._led

    def _swings(self, now_s: float) -> str:
        """Return a message while a copter that was led off has not come to rest: it would overshoot its top speed."""
        position = self._vehicle.heard_since("LOCAL_POSITION_NED", self._led_s)
        # Written so that a speed that is not a number counts as one.
        if position is None or not math.hypot(position.vx, position.vy) <= self._moving_m_s:
            self._moved_s = now_s
        if not self._vehicle.kind.flies or now_s - self._moved_s > _RESTS_S:
            return ""
        return "another ground station has sent it elsewhere, and it has not come to rest since"
