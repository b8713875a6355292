"""How a vehicle is told to stop, and to stay where it is."""

from __future__ import annotations

import math
from typing import Final

from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import ARDUCOPTER, Vehicle
from soter.clock import Clock
from soter.sdk import Capabilities, Controller, RobotState

_Place = tuple[float, float, float]


class Standing:
    """Stops one vehicle. Used in the supervisor's thread.

    - A rover, and whatever has a gate, is told at every tick that its velocity is nothing.
    - An ArduCopter without a gate is sent the place where it can stop. When it is sent a velocity after a place, or a
      place after a velocity, it goes on accelerating or braking as it did then, as if the wind had to be held out
      against, and comes up to twice its speed limit.
    - A boat is told to stop for as long as it may brake, and nothing more: ArduRover keeps its place only once it has
      been told nothing for a while.
    """

    def __init__(self, vehicle: Vehicle, setpoints: Setpoints, promised: Capabilities, clock: Clock) -> None:
        self._vehicle: Final = vehicle
        self._setpoints: Final = setpoints
        self._promised: Final = promised
        self._clock: Final = clock
        self._halted_at: _Place | None = None
        self._sent_to: _Place | None = None
        self._halted_s: float | None = None

    def begin(self, at: RobotState | None) -> None:
        """Begin anew with a vehicle that was made ready, which is here."""
        self._halted_at = self._halted_s = self._sent_to = None
        self._note(at)

    def driven_on(self) -> None:
        """Note that the vehicle is told something else than to stand."""
        self._halted_at = self._halted_s = None

    def sent(self, place: _Place) -> None:
        """Note the place that it was sent to."""
        self._sent_to = place

    def taken(self, *, led: bool) -> None:
        """Note that it does something else: only from now on an ArduCopter comes to rest before it gets places.

        Args:
            led: whether another sends it places, which only what a boat is told now overwrites.
        """
        if led or not self._vehicle.kind.drifts:
            self._halted_s = None

    def drifted(self, at: RobotState | None) -> str:
        """Return a message if a boat that was left alone has drifted beyond its promise; it is told to stop again."""
        most_m = self._promised.position_noise_m
        if at is None or self._halted_at is None or not self._vehicle.kind.drifts:
            return ""
        off_m = math.dist((at.x_m, at.y_m), self._halted_at[:2])
        if off_m <= most_m:
            return ""
        self.driven_on()
        return f"it has drifted {off_m:.1f} m from where it had stopped, promise.position_noise_m is {most_m:g}"

    @property
    def brakes(self) -> bool:
        """Whether an ArduCopter that was stopped by a velocity may not be at rest yet."""
        return self._vehicle.kind == ARDUCOPTER and self._may_brake()

    def is_late(self, at: RobotState) -> bool:
        """Whether samples wait on the link: then targets may wait as well, and arrive when they are no longer valid."""
        promised = self._promised
        return self._clock.now() - at.stamp_s > promised.sample_age_s + promised.jitter_s + promised.lease_s

    def stand(self, by: Controller, at: RobotState | None, *, plainly: bool) -> None:
        """Tell the vehicle to stop and stay.

        Args:
            by: the active controller.
            at: where the vehicle is; None if that is not known.
            plainly: whether a velocity will do for any vehicle, since it has a gate or is not ready.
        """
        if self._vehicle.kind.drifts:
            self._hold(by, at)
        elif plainly or self._vehicle.kind != ARDUCOPTER:
            self._setpoints.stand(by)
        else:
            self._stop(by, at)

    def _hold(self, by: Controller, at: RobotState | None) -> None:
        """Tell a boat to stop while it may still brake, and then leave it to its autopilot."""
        self._note(at)
        if self._halted_s is None:
            self._halted_at, self._halted_s = None, self._clock.now()
        if self._may_brake(self._promised.latency_s):
            self._setpoints.stand(by)
        elif self._halted_at is None and at is not None:
            self._halted_at = at.x_m, at.y_m, at.z_m

    def _stop(self, by: Controller, at: RobotState | None) -> None:
        place = None
        if at is not None and not self.brakes:
            place = self._halted_at or (self._sent_to if self.is_late(at) else self._stopping_place(at))
        self._halted_at = self._sent_to = place
        if place is None:
            self._halted_s = self._clock.now() if self._halted_s is None else self._halted_s
            self._setpoints.stand(by)
            return
        self._halted_s = None
        self._setpoints.stand_at(by, *place)

    def _may_brake(self, late_s: float = 0.0) -> bool:
        promised, since_s = self._promised, self._halted_s
        return since_s is not None and self._clock.now() - since_s <= late_s + promised.v_max_m_s / promised.brake_m_s2

    def _stopping_place(self, at: RobotState) -> _Place:
        """Return where a vehicle comes to rest that brakes as promised."""
        ahead_s = self._clock.now() - at.stamp_s + _speed_m_s(at) / (2.0 * self._promised.brake_m_s2)
        return at.x_m + ahead_s * at.vx_m_s, at.y_m + ahead_s * at.vy_m_s, at.z_m

    def _note(self, at: RobotState | None) -> None:
        """Note where a boat stands as a place of ours: its autopilot says that its target is there."""
        if at is not None and self._vehicle.kind.drifts:
            self._setpoints.count(at.x_m, at.y_m, at.z_m)


def _speed_m_s(at: RobotState) -> float:
    return math.hypot(at.vx_m_s, at.vy_m_s)
