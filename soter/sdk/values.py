"""The values that cross the narrow interface. Frame: workspace, ENU, metres, radians counter-clockwise from east."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from numbers import Real
from typing import Final, NamedTuple

from soter.controller import Controller as Controller
from soter.controller import direct

MAX_COORDINATE_M = 25_000.0
"""A coordinate beyond this is a mistake."""

_MOVING_M_S: Final = 0.02

REST_M_S: Final = 1e-3
REST_RAD_S: Final = 1e-2
"""Turn rate up to which a robot without noise counts as standing still."""

MAX_HEADING_RAD = 1e6
"""A heading beyond this is a mistake: it has lost its precision, and may overflow in a vehicle's own unit."""


@direct
class Link(Enum):
    """State of a robot's link, judged by the age of its latest sample."""

    UP = "UP"
    STALE = "STALE"
    DOWN = "DOWN"


@direct
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
        for value in values:
            if type(value) is not float and value is not None and not isinstance(value, Real):
                raise TypeError(f"Waypoint has a {type(value).__name__} in {self!r}, allowed: numbers")
        for name in ("x_m", "y_m", "z_m"):
            value = getattr(self, name)
            # Written so that NaN fails too.
            if not -max_coordinate_m <= value <= max_coordinate_m:
                raise ValueError(f"Waypoint.{name} is {value}, allowed: finite, at most +-{max_coordinate_m:g} m")
        if self.heading_rad is not None and not -MAX_HEADING_RAD <= self.heading_rad <= MAX_HEADING_RAD:
            allowed = f"finite, at most +-{MAX_HEADING_RAD:g}, or None"
            raise ValueError(f"Waypoint.heading_rad is {self.heading_rad}, allowed: {allowed}")
        if self.speed_m_s is not None and not (self.speed_m_s > 0.0 and _is_finite(self.speed_m_s)):
            raise ValueError(f"Waypoint.speed_m_s is {self.speed_m_s}, allowed: above 0, or None")
        if not (self.radius_m > 0.0 and _is_finite(self.radius_m)):
            raise ValueError(f"Waypoint.radius_m is {self.radius_m}, allowed: above 0")
        if not (self.timeout_s > 0.0 and _is_finite(self.timeout_s)):
            raise ValueError(f"Waypoint.timeout_s is {self.timeout_s}, allowed: above 0")

    def in_floats(self) -> Waypoint:
        """Return the same waypoint with Python floats; most wires cannot encode other numbers, such as NumPy's."""
        if all(type(value) is float or value is None for value in self):
            return self
        return Waypoint(*(None if value is None else float(value) for value in self))  # type: ignore[arg-type]


def _is_finite(value: float) -> bool:
    """Return whether a number is finite as a Python float; compared in 32 bits, a limit could itself be infinite."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


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
        battery: charge from 0 to 1; None if unknown.
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

    def age_s(self, now_s: float) -> float:
        """Return how old the sample is at fleet time `now_s`, in seconds."""
        return now_s - self.stamp_s


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a robot promises. The proofs rest on these numbers, and the conformance kit measures them.

    Attributes:
        in_process: the robot lives in this process, in virtual time.
        deterministic: the same calls give the same samples, bit for bit.
        reverses: it can drive backwards.
        reports_battery: samples carry a charge.
        reports_controller: samples carry the controller in charge.
        v_max_m_s: top speed, clamped on the robot's side.
        yaw_rate_max_rad_s: top turn rate.
        brake_m_s2: deceleration that it never falls short of.
        body_radius_m: a disc of this radius around the position holds the whole body.
        latency_s: from a call to the moment the vehicle acts on it, at most.
        sample_age_s: age of the latest sample when it is read, at most.
        jitter_s: how late a tick may come, at most.
        setpoint_period_s: the vehicle's own control period.
        lease_s: without renewal for this long the vehicle stops by itself.
        tube_m: how far the vehicle strays from the straight segment to its target, at most.
        overshoot_m: how far it runs beyond a target, at most.
        position_noise_m: error of a reported position, at most.
        pivots_first: it turns in place before it drives.
        accel_m_s2: how fast its speed along the heading grows, at most; None if not promised.
        speed_noise_m_s: error of a reported velocity, at most; None if not promised.
        heading_noise_rad: error of a reported heading, at most; None if not promised.
    """

    in_process: bool
    deterministic: bool
    reverses: bool
    reports_battery: bool
    reports_controller: bool
    v_max_m_s: float
    yaw_rate_max_rad_s: float
    brake_m_s2: float
    body_radius_m: float
    latency_s: float
    sample_age_s: float
    jitter_s: float
    setpoint_period_s: float
    lease_s: float
    tube_m: float
    overshoot_m: float
    position_noise_m: float
    pivots_first: bool
    accel_m_s2: float | None = None
    speed_noise_m_s: float | None = None
    heading_noise_rad: float | None = None

    @property
    def moving_m_s(self) -> float:
        """Reported speed above which a robot moves, whatever the noise; at or below it, the robot may stand."""
        return _MOVING_M_S + (self.speed_noise_m_s or 0.0)

    def rests(self, state: RobotState) -> bool:
        """Return whether a robot that reports this state stands still, as far as its noise allows to tell.

        The speed noise also bounds how fast the rim of its body may seem to move.
        """
        noise_m_s, turns_rad_s = self.speed_noise_m_s or 0.0, abs(state.yaw_rate_rad_s)
        return math.hypot(state.vx_m_s, state.vy_m_s) <= REST_M_S + noise_m_s and (
            turns_rad_s <= REST_RAD_S or 0.0 < turns_rad_s * self.body_radius_m <= noise_m_s
        )

    def unrest(self, state: RobotState) -> str:
        """Return, in words, why a robot that was told to stand and reports this state does not count as standing."""
        speed_m_s = math.hypot(state.vx_m_s, state.vy_m_s)
        return (
            f"it does not come to rest although it has no goal: it reports {speed_m_s:.3f} m/s and "
            f"{state.yaw_rate_rad_s:.3f} rad/s; does something else move it? If not, that is noise, and "
            f"promise.speed_noise_m_s = {self.speed_noise_m_s} allows too little of it"
        )

    def widened_beyond(self, declared: Capabilities) -> str | None:
        """Return the name of the first promise that is worse than `declared`, as `WIDENS` says; None if none is."""
        for name in self.__slots__:
            mine, theirs = getattr(self, name), getattr(declared, name)
            # A figure that is not promised may be anything.
            mine, theirs = (math.inf if each is None else each for each in (mine, theirs))
            # Written so that NaN counts as worse.
            up, down = mine <= theirs, mine >= theirs
            if not {Widens.UP: up, Widens.DOWN: down, Widens.EITHER_WAY: up and down}[WIDENS[name]]:
                return name
        return None


class Widens(Enum):
    """The direction of change of a promise that lets a robot do what the proofs rule out."""

    UP = "up"
    DOWN = "down"
    EITHER_WAY = "either way"


WIDENS: Final[Mapping[str, Widens]] = {
    "in_process": Widens.EITHER_WAY,
    "deterministic": Widens.UP,
    # A robot may lack an ability of its class, and is then supervised without it; it may not claim more.
    "reverses": Widens.UP,
    "reports_battery": Widens.UP,
    "reports_controller": Widens.UP,
    "v_max_m_s": Widens.UP,
    # Faster turns lead where nothing was checked; slower ones take longer than waits and return paths are paid for.
    "yaw_rate_max_rad_s": Widens.EITHER_WAY,
    "brake_m_s2": Widens.DOWN,
    "body_radius_m": Widens.UP,
    "latency_s": Widens.UP,
    "sample_age_s": Widens.UP,
    "jitter_s": Widens.UP,
    "setpoint_period_s": Widens.UP,
    "lease_s": Widens.UP,
    "tube_m": Widens.UP,
    "overshoot_m": Widens.UP,
    "position_noise_m": Widens.UP,
    "pivots_first": Widens.UP,
    "accel_m_s2": Widens.UP,
    "speed_noise_m_s": Widens.UP,
    "heading_noise_rad": Widens.UP,
}
"""By promise, for all fields of `Capabilities`: which change widens it."""


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
