"""Routes that a vehicle follows by itself: landing, going home, and missions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.kinds import Kind
from soter_sim.mavlink.mission import Item, Mission
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint, Velocity

_AT_HEIGHT_M: Final = 0.1


class Route(Protocol):
    """A route that a vehicle follows by itself.

    Attributes:
        lands: whether it is landing; its motors are switched off once it has landed.
    """

    lands: bool

    def setpoint(self, sample: Sample, now_s: float) -> Setpoint:
        """Return the present set-point; called once in each control period."""


@dataclass(frozen=True, slots=True)
class Manners:
    """Settings of the routes of a vehicle.

    Attributes:
        speed_m_s: cruising speed.
        radius_m: distance at which it has arrived.
        land_m_s: speed of descent when landing.
        rtl_m: height to which it climbs before it goes home.
    """

    speed_m_s: float
    radius_m: float
    land_m_s: float
    rtl_m: float


class Landing:
    """Lands where the vehicle is."""

    def __init__(self, manners: Manners) -> None:
        self.lands = True
        self._down = Velocity(0.0, 0.0, -manners.land_m_s)

    def setpoint(self, sample: Sample, now_s: float) -> Setpoint:
        return self._down


class Homing:
    """Goes home in a straight line: a rover on the ground, a copter at a height, and then lands."""

    def __init__(self, kind: Kind, home: tuple[float, float, float], sample: Sample, manners: Manners) -> None:
        self.lands = False
        self._manners = manners
        if kind.flies:
            high_m = max(sample.z_m, manners.rtl_m)
            self._legs = [
                Place(sample.x_m, sample.y_m, high_m, None, manners.speed_m_s),
                Place(home[0], home[1], high_m, None, manners.speed_m_s),
            ]
            self._then: Landing | None = Landing(manners)
        else:
            self._legs = [Place(home[0], home[1], 0.0, None, manners.speed_m_s)]
            self._then = None

    def setpoint(self, sample: Sample, now_s: float) -> Setpoint:
        legs = self._legs
        if legs and is_there(sample, legs[0], self._manners.radius_m) and (len(legs) > 1 or self._then):
            legs.pop(0)
        if legs:
            return legs[0]
        assert self._then is not None
        self.lands = True
        return self._then.setpoint(sample, now_s)


class Touring:
    """Executes a mission.

    Args:
        kind: kind of the vehicle.
        mission: the mission, whose `current` advances as items are done.
        origin: the EKF's origin.
        home: home, for items that go there.
        manners: called whenever an item begins; returns the settings.
        reached: called with the number of an item that is done.
        set_speed: called with the speed that an item sets, or None for the default.
    """

    def __init__(
        self,
        kind: Kind,
        mission: Mission,
        origin: Origin,
        home: tuple[float, float, float],
        manners: Callable[[], Manners],
        reached: Callable[[int], None],
        set_speed: Callable[[float | None], None],
    ) -> None:
        self.lands = False
        self.done = False
        self._kind, self._mission, self._origin, self._home = kind, mission, origin, home
        self._manners, self._reached, self._set_speed = manners, reached, set_speed
        self._doing: Item | None = None
        self._place: Place | None = None
        self._route: Landing | Homing | None = None
        self._since_s: float | None = None

    def setpoint(self, sample: Sample, now_s: float) -> Setpoint:
        # Items that only change a setting take no time, so several may be done at once.
        for _ in range(len(self._mission.items) + 1):
            item = self._mission.item(max(self._mission.current, 1))
            if item is None:
                self.done = True
                # Keep to the last place, which may not be quite reached; a mission that was cleared has none.
                return self._place if self._mission.items else None
            self.done = False
            if item is not self._doing:
                self._begin(item, sample)
            if not self._is_done(item, sample, now_s):
                break
            self._next()
        if self._route is not None:
            self.lands = self._route.lands
            return self._route.setpoint(sample, now_s)
        return self._place

    def landed(self) -> None:
        """Note that the vehicle has landed, as an item asked."""
        if self._doing is not None and self._doing.command == mav.MAV_CMD_NAV_LAND:
            self._next()

    def _next(self) -> None:
        seq = max(self._mission.current, 1)
        self._reached(seq)
        self._mission.current = seq + 1
        self._doing = None

    def _begin(self, item: Item, sample: Sample) -> None:
        manners = self._manners()
        self._doing, self._since_s, self._route, self.lands = item, None, None, False
        self._mission.current = max(self._mission.current, 1)
        before = self._place
        # An item without a place is executed at the last place, or where the vehicle is.
        x_m, y_m, z_m = (sample.x_m, sample.y_m, sample.z_m) if before is None else (before.x_m, before.y_m, before.z_m)
        if item.command == mav.MAV_CMD_NAV_TAKEOFF:
            z_m = item.place(self._origin)[2]
        elif item.command == mav.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._route = Homing(self._kind, self._home, sample, manners)
        elif item.has_place:
            x_m, y_m, up_m = item.place(self._origin)
            if self._kind.flies and item.command != mav.MAV_CMD_NAV_LAND:
                z_m = up_m
        self._place = Place(x_m, y_m, z_m, None, manners.speed_m_s)

    def _is_done(self, item: Item, sample: Sample, now_s: float) -> bool:
        place = self._place
        assert place is not None
        if item.command == mav.MAV_CMD_DO_CHANGE_SPEED:
            self._set_speed(item.params[1] if item.params[1] > 0.0 else None)
            return True
        if self._route is not None:
            return False
        if not is_there(sample, place, self._manners().radius_m):
            return False
        if item.command == mav.MAV_CMD_NAV_LAND:
            self._route = Landing(self._manners())
            return False
        if self._since_s is None:
            self._since_s = now_s
        waits_s = item.params[0] if item.command != mav.MAV_CMD_NAV_TAKEOFF else 0.0
        return now_s - self._since_s >= waits_s


def is_there(sample: Sample, place: Place, radius_m: float) -> bool:
    """Return whether a vehicle has arrived at a place."""
    return hypot(place.x_m - sample.x_m, place.y_m - sample.y_m) <= radius_m and abs(place.z_m - sample.z_m) <= max(
        radius_m, _AT_HEIGHT_M
    )
