"""Multicopters without physics: point masses with limited acceleration, in the same world and under the same rules.

Velocity changes towards what the pilot wants, along a straight line and at most at a constant rate: east and north
together, up by itself. Within a step it is linear, so that positions are exact. The rules are those of ground robots,
seen from above: a copter is a disc at any height, and boxes have no top, so copters cannot pass over them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, hypot, isfinite, pi, sin
from typing import Final, NamedTuple

from soter.geometry.workspace import Workspace
from soter.onboard.drive import DriveLimits
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import Bodies
from soter_sim.contacts import Contacts
from soter_sim.judge import Judge

STEP_S: Final = 0.05
"""Default control period and integration step."""

V_MAX_M_S: Final = 0.5
"""Top speed over the ground."""

ACCEL_M_S2: Final = 2.0
"""Largest acceleration, over the ground and up; braking always reaches it."""

CLIMB_MAX_M_S: Final = 0.5
"""Top speed up and down."""

YAW_RATE_MAX_RAD_S: Final = 1.5
"""Top turn rate."""

LIMITS: Final = DriveLimits(V_MAX_M_S, YAW_RATE_MAX_RAD_S, ACCEL_M_S2, ACCEL_M_S2)
"""Default limits; a copter accelerates at its braking rate, in any direction."""

SINK_M_S: Final = 0.3
"""Speed at which a copter with an empty battery comes down, straight."""


class Flight(NamedTuple):
    """State of a copter.

    Attributes:
        x_m: east.
        y_m: north.
        z_m: up from the ground.
        heading_rad: in (-pi, pi].
        east_m_s: velocity.
        north_m_s: velocity.
        up_m_s: velocity.
        yaw_rate_rad_s: counter-clockwise.
    """

    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    east_m_s: float
    north_m_s: float
    up_m_s: float
    yaw_rate_rad_s: float


Wanted = tuple[float, float, float, float]
"""A pilot's command: velocity east, north and up in m/s, and the turn rate in rad/s."""

Pilot = Callable[[float, Flight], Wanted]
"""A copter's control, called once in each control period with the time in seconds and the copter's state."""

_HOVER: Final[Wanted] = (0.0, 0.0, 0.0, 0.0)


def hover(_now_s: float, _flight: Flight) -> Wanted:
    """Return the command to rest; the default pilot. A copter on the ground stays there."""
    return _HOVER


class CopterEngine:
    """Moves copters; implements `soter_sim.engine.Engine`.

    It uses `pilots` instead of `bodies.control`, whose commands have no vertical part.

    Args:
        workspace: fence, boxes and chargers.
        specs: the copters; they start on the ground.
        limits: what the mission promises.
        step_s: control period and integration step.

    Attributes:
        z: metres above the ground, by robot.
        pilots: the pilot of each copter.
    """

    def __init__(
        self,
        workspace: Workspace,
        specs: Sequence[RobotSpec],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
        step_s: float = STEP_S,
    ) -> None:
        self.bodies = Bodies(specs, LIMITS)
        self.period_s = step_s
        fastest_m_s = max(each.v_max_m_s for each in self.bodies.limits)
        self._judge = Judge(workspace, self.bodies, step_s, fastest_m_s, limits)
        self.record = self._judge.record
        count = len(specs)
        self.z = [0.0] * count
        self.pilots: list[Pilot] = [hover] * count
        self._east, self._north, self._up = [0.0] * count, [0.0] * count, [0.0] * count
        self._to_x, self._to_y = [*self.bodies.x], [*self.bodies.y]
        self._contacts = Contacts(self._judge, self.bodies, self._to_x, self._to_y, step_s)
        self._done = 0

    def run(self, until_period: int) -> None:
        bodies, judge = self.bodies, self._judge
        for step in range(self._done, until_period):
            for i in range(len(self.z)):
                self._fly(i, step * self.period_s)
            if step >= judge.due:
                stops = self._contacts.stop(step)
                for i in stops or ():
                    self._east[i] = self._north[i] = 0.0
                judge.look(step, self._to_x, self._to_y, stops)
            bodies.x[:] = self._to_x
            bodies.y[:] = self._to_y
            self._done = step + 1

    def velocity(self, index: int) -> tuple[float, float]:
        return self._east[index], self._north[index]

    def flight(self, index: int) -> Flight:
        """Return the state of a copter."""
        bodies = self.bodies
        return Flight(
            bodies.x[index], bodies.y[index], self.z[index], bodies.heading[index],
            self._east[index], self._north[index], self._up[index], bodies.yaw_rate[index],
        )  # fmt: skip

    def close(self) -> None:
        """Do nothing: there is nothing to free."""

    def _fly(self, i: int, now_s: float) -> None:
        """Call the pilot, and compute where one step takes the copter."""
        bodies, step_s, limits = self.bodies, self.period_s, self.bodies.limits[i]
        east, north, up, turn = _clamped(self.pilots[i](now_s, self.flight(i)), limits)
        if bodies.charge[i] <= 0.0:
            east, north, up, turn = 0.0, 0.0, -SINK_M_S, 0.0
        z_m = self.z[i]
        if z_m <= 0.0 and up <= 0.0:
            # On the ground it neither slides nor turns.
            east = north = up = turn = 0.0
        most_m_s = limits.brake_m_s2 * step_s
        was_east, was_north, was_up = self._east[i], self._north[i], self._up[i]
        change_m_s = hypot(east - was_east, north - was_north)
        part = min(1.0, most_m_s / change_m_s) if change_m_s > 0.0 else 1.0
        east, north = was_east + part * (east - was_east), was_north + part * (north - was_north)
        up = was_up + min(max(up - was_up, -most_m_s), most_m_s)
        self._to_x[i] = bodies.x[i] + 0.5 * (was_east + east) * step_s
        self._to_y[i] = bodies.y[i] + 0.5 * (was_north + north) * step_s
        z_m += 0.5 * (was_up + up) * step_s
        if z_m <= 0.0:
            z_m, up = 0.0, max(up, 0.0)
        self._use_charge(i, now_s, flies=z_m > 0.0)
        self._east[i], self._north[i], self._up[i], self.z[i] = east, north, up, z_m
        heading_rad = bodies.heading[i] = pi - (pi - bodies.heading[i] - turn * step_s) % (2.0 * pi)
        bodies.v[i] = east * cos(heading_rad) + north * sin(heading_rad)
        bodies.yaw_rate[i] = turn

    def _use_charge(self, i: int, now_s: float, *, flies: bool) -> None:
        """Charge, or use charge, for one step; flying uses as much as driving at top speed."""
        bodies, judge = self.bodies, self._judge
        left, on_charger = bodies.charge[i], judge.on_charger[i]
        if on_charger and not flies and self._east[i] == self._north[i] == 0.0:
            if left <= 0.0:
                judge.charged(i, now_s)
            bodies.charge[i] = min(left + bodies.charge_per_s[i] * self.period_s, 1.0)
        elif left > 0.0:
            use = (bodies.drive_per_s[i] if flies else bodies.idle_per_s[i]) * self.period_s
            if left <= use:
                if not on_charger:
                    judge.flat(i, now_s + left / use * self.period_s)
                left = use
            bodies.charge[i] = left - use
        elif not on_charger:
            judge.flat(i, now_s)
        least = self.record.min_margin
        least["battery"] = min(least["battery"], bodies.charge[i])


def _clamped(wanted: Wanted, limits: DriveLimits) -> Wanted:
    """Return a command within a copter's limits; rest for NaN."""
    if not all(map(isfinite, wanted)):
        return _HOVER
    east, north, up, turn = wanted
    speed_m_s, v_max_m_s, yaw_rate_max_rad_s = hypot(east, north), limits.v_max_m_s, limits.yaw_rate_max_rad_s
    if speed_m_s > v_max_m_s:
        east, north = east * v_max_m_s / speed_m_s, north * v_max_m_s / speed_m_s
    return (
        east,
        north,
        min(max(up, -CLIMB_MAX_M_S), CLIMB_MAX_M_S),
        min(max(turn, -yaw_rate_max_rad_s), yaw_rate_max_rad_s),
    )
