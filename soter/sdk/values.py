"""The values that cross the narrow interface. Frame: workspace, ENU, metres, radians counter-clockwise from east."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from numbers import Real
from typing import Any, Final, NamedTuple, get_type_hints

from soter.controller import Controller as Controller
from soter.sdk.capabilities import Capabilities, is_finite

MAX_COORDINATE_M = 25_000.0
"""A coordinate beyond this is a mistake."""

MAX_HEADING_RAD = 1e6
"""A heading beyond this is a mistake: it has lost its precision, and may overflow in a vehicle's own unit."""


class Link(Enum):
    """State of a robot's link, judged by the age of its latest sample."""

    UP = "UP"
    STALE = "STALE"
    DOWN = "DOWN"


class GoalStatus(Enum):
    """Status of a goal. It leaves ACTIVE once, for one of the others, and stays there."""

    ACTIVE = "active"
    REACHED = "reached"
    SUPERSEDED = "superseded"
    PREEMPTED = "preempted"
    REJECTED = "rejected"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed_out"
    FAILED = "failed"


_OPTIONAL: Final = ("heading_rad", "speed_m_s")
"""What a waypoint may leave open, by None."""


class Waypoint(NamedTuple):
    """A place to go to, with its own radius of arrival and time-out.

    Attributes:
        x_m: east.
        y_m: north.
        z_m: up; 0 for a ground robot.
        heading_rad: the heading to arrive with, or None. A vehicle that can reverse drives the leg backwards if it then
            arrives with this heading.
        speed_m_s: a cap on the speed on the way, or None for the vehicle's own.
        radius_m: the goal is reached when the robot is at most this far from the place.
        timeout_s: fleet time after which the goal is TIMED_OUT and the robot stops.
    """

    x_m: float
    y_m: float
    z_m: float = 0.0
    heading_rad: float | None = None
    speed_m_s: float | None = None
    radius_m: float = 0.10
    timeout_s: float = 120.0

    def check(self, max_coordinate_m: float = MAX_COORDINATE_M) -> None:
        """Raise unless all values are numbers that a robot can work with.

        Raises:
            ValueError: a value is not finite or out of range; the message names it.
            TypeError: a value is not a number: one that only compares like a number would fail later, in the vehicle.
        """
        values: tuple[object, ...] = self
        for name, value in zip(self._fields, values, strict=True):
            if (
                type(value) is not float
                and not isinstance(value, Real)
                and (value is not None or name not in _OPTIONAL)
            ):
                kind = type(value).__name__
                raise TypeError(f"Waypoint.{name} is of type {kind} in {self!r}, allowed: numbers")
        for name in ("x_m", "y_m", "z_m"):
            value = getattr(self, name)
            # Written so that NaN fails too.
            if not -max_coordinate_m <= value <= max_coordinate_m:
                raise ValueError(f"Waypoint.{name} is {value}, allowed: finite, at most +-{max_coordinate_m:g} m")
        if self.heading_rad is not None and not -MAX_HEADING_RAD <= self.heading_rad <= MAX_HEADING_RAD:
            allowed = f"finite, at most +-{MAX_HEADING_RAD:g}, or None"
            raise ValueError(f"Waypoint.heading_rad is {self.heading_rad}, allowed: {allowed}")
        if self.speed_m_s is not None and not (self.speed_m_s > 0.0 and is_finite(self.speed_m_s)):
            raise ValueError(f"Waypoint.speed_m_s is {self.speed_m_s}, allowed: above 0, or None")
        if not (self.radius_m > 0.0 and is_finite(self.radius_m)):
            raise ValueError(f"Waypoint.radius_m is {self.radius_m}, allowed: above 0")
        if not (self.timeout_s > 0.0 and is_finite(self.timeout_s)):
            raise ValueError(f"Waypoint.timeout_s is {self.timeout_s}, allowed: above 0")

    def in_floats(self) -> Waypoint:
        """Return the same waypoint with Python floats; most wires cannot encode other numbers, such as NumPy's."""
        if all(type(value) is float or value is None for value in self):
            return self
        return Waypoint(*(None if value is None else float(value) for value in self))  # type: ignore[arg-type]


class RobotState(NamedTuple):
    """The latest sample of one robot.

    Attributes:
        robot_id: the robot.
        stamp_s: fleet time at which the vehicle was in this state.
        vehicle_stamp_s: the same moment on the vehicle's own clock.
        x_m: east.
        y_m: north.
        z_m: up.
        heading_rad: body heading in (-pi, pi].
        vx_m_s: velocity, east.
        vy_m_s: velocity, north.
        yaw_rate_rad_s: turn rate, counter-clockwise.
        battery: charge from 0 to 1, never more than is left: round down; None if unknown.
        controller: the active controller that the robot itself reports; None if it reports none.
        goal_id: the goal that the robot is working on, or None.
        link: state of the link.
        vz_m_s: velocity, up; None if not reported.
    """

    robot_id: int
    stamp_s: float
    vehicle_stamp_s: float
    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    vx_m_s: float
    vy_m_s: float
    yaw_rate_rad_s: float
    battery: float | None
    controller: Controller | None
    goal_id: int | None
    link: Link
    vz_m_s: float | None = None

    def in_floats(self) -> RobotState:
        """Return the same sample with Python floats; recordings cannot take other numbers, such as NumPy's.

        Raises:
            TypeError: what should be a number is none.
        """
        numbers = ((name, getattr(self, name)) for name in _FLOATS)
        # `float` alone would take text for a number.
        plain: dict[str, Any] = {name: float(value + 0.0) for name, value in numbers if value is not None}
        return self._replace(**plain)

    def age_s(self, now_s: float) -> float:
        """Return how old the sample is at fleet time `now_s`, in seconds."""
        return now_s - self.stamp_s


_FLOATS: Final = tuple(name for name, kind in get_type_hints(RobotState).items() if kind in (float, float | None))


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """One robot that a backend is to open.

    Attributes:
        id: its number, from 1; also the MAVLink system id.
        x_m: its expected position at the start, east (a simulated robot is put there).
        y_m: its expected position at the start, north.
        heading_rad: its expected heading at the start.
        battery: charge from 0 to 1 that a simulated robot starts with; None for full.
        drive_s: time from full to empty when driving, of a simulated robot.
        idle_s: time from full to empty when standing still, of a simulated robot.
        charge_s: time from empty to full at a charger, of a simulated robot.
        name: the robot's name on a wire that has names.
        promised: what this robot promises, if known beforehand: every robot declares it, and a simulated one is built
            with that size, speed and brakes. None for what its class declares.
    """

    id: int
    x_m: float
    y_m: float
    heading_rad: float
    battery: float | None = None
    drive_s: float = 1800.0
    idle_s: float = 7200.0
    charge_s: float = 60.0
    name: str = ""
    promised: Capabilities | None = None


@dataclass(frozen=True, slots=True)
class FaultReport:
    """What one injected fault did to one robot.

    Attributes:
        kind: the fault's kind.
        robot_id: the robot.
        declared: whether the robot's promises allow for it.
        affected: how often it altered a command or a sample, or impaired the vehicle.
    """

    kind: str
    robot_id: int
    declared: bool
    affected: int


class HeldMission(NamedTuple):
    """A mission that a robot itself holds.

    Attributes:
        points: the places that it would visit, in order: metres, x and y in the workspace.
        left_out: what else the mission would do, in words.
    """

    points: tuple[tuple[float, float], ...]
    left_out: tuple[str, ...] = ()


RULES = ("battery", "geofence", "collision", "obstacle")
"""The safety rules that a simulated world judges, in the order in which reports name them."""


@dataclass(frozen=True, slots=True)
class RuleLimits:
    """Limits below which a simulated world counts a rule as broken: what the mission promises, with or without modules.

    Bodies that overlap, and a body in a box, always break a rule, whatever the limits.

    Attributes:
        separation_m: least distance of two centres.
        clearance_m: least distance of a body to a box.
    """

    separation_m: float = 0.3
    clearance_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Violation:
    """One maximal interval in which a rule was broken.

    Attributes:
        rule: one of `RULES`.
        robots: ids of the robot, or of the pair.
        start_s: fleet time.
        end_s: fleet time; None if it lasted to the end.
    """

    rule: str
    robots: tuple[int, ...]
    start_s: float
    end_s: float | None


@dataclass(frozen=True, slots=True)
class TruthReport:
    """What really happened, judged by the world at its own rate.

    Attributes:
        violations: every interval, oldest first.
        min_margin: by rule, the least margin seen: metres, or charge from 0 to 1 for the battery.
        contacts: number of times that bodies began to touch, a robot and a box or two robots.
        ended_s: fleet time at which the world fell silent, after which nothing is known; None while it is heard.
        charges: by robot, the charge that is left now, from 0 to 1; empty if the world does not report it.
    """

    violations: tuple[Violation, ...]
    min_margin: Mapping[str, float] = field(default_factory=dict)
    contacts: int = 0
    ended_s: float | None = None
    charges: Mapping[int, float] = field(default_factory=dict)

    def count(self, rule: str) -> int:
        """Return the number of violations of one rule."""
        return sum(violation.rule == rule for violation in self.violations)
