"""The simulated world: bodies that accelerate, turn, bump and run flat, and a judge of what really happens.

Inside, everything is metres east and north and radians counter-clockwise from east; what robots say on the wire is
their own affair. One step is `PERIOD_S`; rules are judged at the end of each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from soter_zmq.drive import ACCEL_M_S2, YAW_ACCEL_RAD_S2
from soter_zmq.wire import BODY_RADIUS_M, BRAKE_M_S2, PERIOD_S, V_MAX_M_S, YAW_RATE_MAX_RAD_S

FENCE_TOLERANCE_M: Final = 1e-6
COLLISION_M: Final = 0.3
PENETRATION_M: Final = 1e-3
_TOUCH_M: Final = 2e-3
_BOX: Final = -1
_HALVINGS: Final = 12

Rectangle = tuple[float, float, float, float]
"""West, south, east and north edge, in metres."""


@dataclass(slots=True)
class Body:
    """One robot's body and battery.

    Attributes:
        id: its number.
        x_m: metres east.
        y_m: metres north.
        heading_rad: counter-clockwise from east.
        charge: 0 to 1.
        drive_s: time from full to empty when driving.
        idle_s: the same at rest.
        charge_s: time from empty to full on a charger, at rest.
        v_m_s: speed along the heading.
        yaw_rate_rad_s: counter-clockwise.
        wanted: the speed and the turn rate to steer for.
    """

    id: int
    x_m: float
    y_m: float
    heading_rad: float
    charge: float
    drive_s: float
    idle_s: float
    charge_s: float
    v_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    wanted: tuple[float, float] = (0.0, 0.0)


@dataclass(slots=True)
class World:
    """A room with boxes, chargers and robots.

    Attributes:
        width_m: the room reaches from 0 to here, east.
        depth_m: the same, north.
        boxes: what stands in it.
        chargers: patches on which a robot at rest charges.
        bodies: the robots.
        steps: how many steps have passed.
        violations: rule, robots, begin and end in seconds; the end is None while it lasts.
        min_margin: by rule, the least margin so far.
        contacts: how often bodies began to touch something.
    """

    width_m: float
    depth_m: float
    boxes: tuple[Rectangle, ...]
    chargers: tuple[Rectangle, ...]
    bodies: tuple[Body, ...]
    steps: int = 0
    violations: list[tuple[str, tuple[int, ...], float, float | None]] = field(default_factory=list)
    min_margin: dict[str, float] = field(default_factory=dict)
    contacts: int = 0
    _open: dict[tuple[str, tuple[int, ...]], int] = field(default_factory=dict)
    _touching: set[tuple[int, int]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._judge()

    @staticmethod
    def read(values: Mapping[str, Any]) -> World:
        """Build a world from what `describe` in `soter_zmq.simulator` writes; see there."""
        return World(
            float(values["width_m"]),
            float(values["depth_m"]),
            tuple((*map(float, box),) for box in values["boxes"]),  # type: ignore[misc]
            tuple((*map(float, patch),) for patch in values["chargers"]),  # type: ignore[misc]
            tuple(Body(**body) for body in values["robots"]),
        )

    @property
    def now_s(self) -> float:
        """Simulated time."""
        return self.steps * PERIOD_S

    def step(self) -> None:
        """Move every body for one period towards what it steers for, then judge."""
        for body in self.bodies:
            self._move(body)
        self.steps += 1
        self._judge()

    def clearance_m(self, x_m: float, y_m: float) -> float:
        """Return how far a body at a place is from the nearest box; negative inside."""
        return min((_distance_m(box, x_m, y_m) for box in self.boxes), default=math.inf) - BODY_RADIUS_M

    # --- motion --------------------------------------------------------------------------------------------

    def _move(self, body: Body) -> None:
        flat = body.charge <= 0.0
        v_m_s, turn_rad_s = (0.0, 0.0) if flat else body.wanted
        # What no motor can do is not done, whoever asks for it.
        v_m_s = min(max(v_m_s, -V_MAX_M_S), V_MAX_M_S)
        turn_rad_s = min(max(turn_rad_s, -YAW_RATE_MAX_RAD_S), YAW_RATE_MAX_RAD_S)
        slows = v_m_s * body.v_m_s < 0.0 or abs(v_m_s) < abs(body.v_m_s)
        new_v_m_s = _towards(body.v_m_s, v_m_s, (BRAKE_M_S2 if slows else ACCEL_M_S2) * PERIOD_S)
        new_turn_rad_s = _towards(body.yaw_rate_rad_s, turn_rad_s, YAW_ACCEL_RAD_S2 * PERIOD_S)
        length_m = 0.5 * (body.v_m_s + new_v_m_s) * PERIOD_S
        angle_rad = 0.5 * (body.yaw_rate_rad_s + new_turn_rad_s) * PERIOD_S
        body.v_m_s, body.yaw_rate_rad_s = new_v_m_s, new_turn_rad_s
        middle_rad = body.heading_rad + 0.5 * angle_rad
        x_m, y_m = body.x_m + length_m * math.cos(middle_rad), body.y_m + length_m * math.sin(middle_rad)
        body.heading_rad = math.remainder(body.heading_rad + angle_rad, 2.0 * math.pi)
        hits = self._hits(body, x_m, y_m) if length_m != 0.0 else []
        if hits:
            x_m, y_m = self._up_to_contact(body, x_m, y_m)
            body.v_m_s = 0.0
            self._touch(body, hits)
        body.x_m, body.y_m = x_m, y_m
        self._use_charge(body, moves=length_m != 0.0 or angle_rad != 0.0)

    def _use_charge(self, body: Body, *, moves: bool) -> None:
        if not moves and self._on_charger(body):
            body.charge = min(1.0, body.charge + PERIOD_S / body.charge_s)
            return
        effort = max(abs(body.v_m_s) / V_MAX_M_S, abs(body.yaw_rate_rad_s) / YAW_RATE_MAX_RAD_S)
        per_s = 1.0 / body.idle_s + effort * (1.0 / body.drive_s - 1.0 / body.idle_s)
        body.charge = max(0.0, body.charge - per_s * PERIOD_S)

    def _hits(self, body: Body, x_m: float, y_m: float) -> list[int]:
        """Return what a body that moves to a place runs into: numbers of robots, and that of no robot for a box."""
        hits = [_BOX] if self.clearance_m(x_m, y_m) < min(0.0, self.clearance_m(body.x_m, body.y_m)) else []
        for other in self.bodies:
            if other is not body:
                after_m = math.hypot(other.x_m - x_m, other.y_m - y_m)
                if after_m < min(2.0 * BODY_RADIUS_M, math.hypot(other.x_m - body.x_m, other.y_m - body.y_m)):
                    hits.append(other.id)
        return hits

    def _up_to_contact(self, body: Body, x_m: float, y_m: float) -> tuple[float, float]:
        """Return how far towards a place a body gets that runs into something on the way."""
        free, blocked = 0.0, 1.0
        dx_m, dy_m = x_m - body.x_m, y_m - body.y_m
        for _ in range(_HALVINGS):
            middle = 0.5 * (free + blocked)
            if self._hits(body, body.x_m + middle * dx_m, body.y_m + middle * dy_m):
                blocked = middle
            else:
                free = middle
        return body.x_m + free * dx_m, body.y_m + free * dy_m

    def _touch(self, body: Body, hits: list[int]) -> None:
        for hit in hits:
            pair = (min(hit, body.id), max(hit, body.id))
            if pair not in self._touching:
                self._touching.add(pair)
                self.contacts += 1

    def _on_charger(self, body: Body) -> bool:
        return any(_distance_m(patch, body.x_m, body.y_m) <= 0.0 for patch in self.chargers)

    # --- the judge -----------------------------------------------------------------------------------------

    def _judge(self) -> None:
        for index, body in enumerate(self.bodies):
            x_m, y_m = body.x_m, body.y_m
            fence_m = min(x_m, self.width_m - x_m, y_m, self.depth_m - y_m)
            self._rule("geofence", (body.id,), fence_m, fence_m < -FENCE_TOLERANCE_M)
            clear_m = self.clearance_m(x_m, y_m)
            if clear_m > _TOUCH_M:
                self._touching.discard((_BOX, body.id))
            touches = (_BOX, body.id) in self._touching
            self._rule("obstacle", (body.id,), clear_m, touches or clear_m < -PENETRATION_M)
            self._rule("battery", (body.id,), body.charge, body.charge <= 0.0 and not self._on_charger(body))
            for other in self.bodies[:index]:
                apart_m = math.hypot(other.x_m - x_m, other.y_m - y_m)
                if apart_m > 2.0 * BODY_RADIUS_M + _TOUCH_M:
                    self._touching.discard((min(other.id, body.id), max(other.id, body.id)))
                pair = (min(other.id, body.id), max(other.id, body.id))
                self._rule("collision", pair, apart_m - COLLISION_M, apart_m < COLLISION_M)

    def _rule(self, rule: str, robots: tuple[int, ...], margin: float, broken: bool) -> None:
        if margin < self.min_margin.get(rule, math.inf):
            self.min_margin[rule] = margin
        if broken:
            self._break(rule, robots)
        elif (rule, robots) in self._open:
            index = self._open.pop((rule, robots))
            self.violations[index] = (*self.violations[index][:3], self.now_s)

    def _break(self, rule: str, robots: tuple[int, ...]) -> None:
        if (rule, robots) not in self._open:
            self._open[rule, robots] = len(self.violations)
            self.violations.append((rule, robots, self.now_s, None))


def _towards(value: float, wanted: float, most: float) -> float:
    return min(max(wanted, value - most), value + most)


def _distance_m(box: Rectangle, x_m: float, y_m: float) -> float:
    west, south, east, north = box
    dx_m, dy_m = max(west - x_m, x_m - east), max(south - y_m, y_m - north)
    return math.hypot(max(dx_m, 0.0), max(dy_m, 0.0)) if max(dx_m, dy_m) > 0.0 else max(dx_m, dy_m)
