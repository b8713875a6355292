"""The base of the bench: samples of the open fleet, the errors of the kit's own readings, and recorded figures."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Final, NoReturn

from soter.conformance.always import Always
from soter.conformance.diagnosis import explain
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.figure import Failed, Figure, NotTested
from soter.conformance.harness import Harness
from soter.conformance.track import Fastest, Ramp, TrackSample, fastest, quantile, turn
from soter.sdk import Capabilities, Fleet, Goal, GoalStatus, Robot, Waypoint

STILL_M: Final = 0.005

STILL_RAD: Final = 0.03
_FADES_M_PER_M_S: Final = 0.02
_HELD: Final = 0.05
"""What moves faster than this share of its top speed does not stand, whatever noise is promised."""

READ_S: Final = 0.003
"""A pose of the truth that took longer than this to read has no known time."""

FIT_S: Final = 0.001
"""How closely real motors follow a fitted change of speed, in time."""

_WINDOW_S: Final = 1.0
_FAST_SHARE: Final = 0.02
_READS: Final = 5
_NEAR_M: Final = 0.05
_MAY_BE: Final = 0.2
_ENDS: Final = 4.0
_MOSTLY: Final = 0.75
_AT_S: Final = attrgetter("at_s")


class Judging:
    """Samples, errors and figures of one clause; the base of `soter.conformance.bench.Bench`.

    Args:
        harness: the adapter's harness.
        truth: whether poses are the truth's instead of the state's.
        needs: capabilities without which the clause does not apply.

    Attributes:
        figures: the measured figures.
        tracks: by robot, the samples while driving, oldest first; one for each stamp.
        fleets: all opened fleets; the last one is open.
        capabilities: what the robots declare; None until one is ready.
        judged: how many robots a clause about one robot opens; the last is judged.
        opener: opens robots in place of the harness's `open`; None for `open` itself.
        faulty: whether the clause has broken the link, so that silence is expected.
        always: the promises that every sample must keep, whatever the clause is about.
        ramps: the changes of speed that were fitted to samples.
    """

    def __init__(self, harness: Harness, *, truth: bool = False, needs: tuple[str, ...] = ()) -> None:
        self.harness = harness
        self.truth = truth
        self.needs = needs
        self.figures: list[Figure] = []
        self.tracks: dict[int, list[TrackSample]] = {}
        self.fleets: list[Fleet] = []
        self._stamps: dict[int, float] = {}
        self._turned: dict[int, float] = {}
        self.capabilities: Capabilities | None = None
        self.faulty = False
        self.ramps: list[Ramp] = []
        self.judged = 1
        self.always = Always()
        self.opener: Callable[[], Fleet] | None = None

    @property
    def fleet(self) -> Fleet:
        """The fleet opened last."""
        return self.fleets[-1]

    @property
    def caps(self) -> Capabilities:
        """What the robots declare."""
        assert self.capabilities is not None
        return self.capabilities

    @property
    def now_s(self) -> float:
        """Fleet time."""
        return self.fleet.clock.now()

    def true_pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is."""
        truth = self.fleet.truth
        return self.harness.observe(robot_id) if truth is None else truth.pose(robot_id)

    def true_place(self, robot: Robot) -> tuple[float, float]:
        """Return where a robot really is; without a truth, where its sample says."""
        if self.fleet.truth is not None or self.harness.gives("observe"):
            return self.true_pose(robot.id)[:2]
        state = robot.read_state()
        return state.x_m, state.y_m

    def heading_off_rad(self, robot: Robot) -> float:
        """Return how far the heading that a robot says is off the true one; 0 if that is what is judged, or unknown."""
        if self.truth or (self.fleet.truth is None and not self.harness.gives("observe")):
            return 0.0
        return turn(self.true_pose(robot.id)[2], robot.read_state().heading_rad)

    def timed_pose(self, robot_id: int) -> tuple[float, tuple[float, float, float]]:
        """Return a fleet time, and the true pose of a robot at that time."""
        for _ in range(_READS):
            before_s, pose, after_s = self.now_s, self.true_pose(robot_id), self.now_s
            if after_s - before_s <= READ_S * self.harness.speedup:
                return (before_s + after_s) / 2.0, pose
            # A busy host has paused this thread between the two readings: read again.
        return self.now_s, self.true_pose(robot_id)

    def since(self, robot: Robot, at_s: float) -> list[TrackSample]:
        """Return the samples of a robot from a moment on."""
        track = self.tracks[robot.id]
        return track[bisect_left(track, at_s - ROUNDING, key=_AT_S) :]

    @property
    def _slow_m_s(self) -> float:
        """The least top speed to expect; a robot that is only measured may be far from its promise."""
        return self.caps.v_max_m_s * (1.0 if self.harness.judges else _MAY_BE)

    @property
    def near_m(self) -> float:
        """Radius of the kit's goals: no less than the promised noise, within which a robot cannot know its place."""
        return max(_NEAR_M, 0.0 if self.capabilities is None else self.capabilities.position_noise_m)

    @property
    def still_m(self) -> float:
        """A robot that moves by no more than this in a second is at rest; more for fast robots, whose motion fades."""
        fades_m = 0.0 if self.capabilities is None else _FADES_M_PER_M_S * self.capabilities.v_max_m_s
        return max(STILL_M, fades_m) + 2.0 * self.noise_m

    @property
    def held_m(self) -> float:
        """A robot that is to stay at rest moves by no more than this in a second.

        By the truth it moves as its velocity is promised to be off, since it holds its place by what it believes.
        """
        noise_m_s = min(self.caps.speed_noise_m_s or 0.0, _HELD * self.caps.v_max_m_s)
        return self.still_m + (noise_m_s if self.truth else 0.0)

    @property
    def still_rad(self) -> float:
        """A robot whose heading changes by no more than this does not turn."""
        return STILL_RAD + 2.0 * self.noise_rad

    @property
    def noise_m(self) -> float:
        """How far a seen place may be off by the noise that the robot promises; 0 for the truth."""
        return 0.0 if self.truth else self.caps.position_noise_m

    @property
    def noise_rad(self) -> float:
        """How far a seen heading may be off by the noise that the robot promises; 0 for the truth."""
        return 0.0 if self.truth else self.caps.heading_noise_rad or 0.0

    @property
    def _blurred_s(self) -> float:
        """How far a fitted moment may be off, by too few samples and by the seen noise, at most by the promised one.

        The noise is that of both ends of the even way before it, and of the place of rest.
        """
        scatter_m = max((each.scatter_m for each in self.ramps), default=0.0)
        unsure_s = quantile([each.unsure_s for each in self.ramps] or [0.0], _MOSTLY)
        return unsure_s + _ENDS * min(scatter_m, self.noise_m) / self.caps.v_max_m_s

    def blurred(self, rate_m_s2: float, *, at_least: bool = False) -> float:
        """Return the relative error of a measured acceleration due to noise, on the side that is judged."""
        lasts_s = self.caps.v_max_m_s / rate_m_s2
        if at_least:
            return self._blurred_s / (lasts_s + self._blurred_s)
        return self._blurred_s / (lasts_s - self._blurred_s) if self._blurred_s < lasts_s else math.inf

    @property
    def speed_noise_m_s(self) -> float:
        """How far a speed may be off, from samples or from poses of the truth over some time."""
        return 0.002 if self.truth else 0.002 + (self.caps.speed_noise_m_s or 0.02 * self.caps.v_max_m_s)

    @property
    def fit_s(self) -> float:
        """How far the fitted moment may be off at which a motion begins to change."""
        return max(self.read_s, FIT_S) + self._blurred_s

    @property
    def read_s(self) -> float:
        """How far the moment of a sample may be off: on a wire clocks are learned, and the truth is read in between."""
        return 0.0 if self.caps.in_process else READ_S

    @property
    def off_m(self) -> float:
        """How far a measured distance may be off, by noise and timing."""
        return 1e-4 + 2.0 * self.noise_m + self.caps.v_max_m_s * self.read_s

    def fastest(self, robot: Robot) -> tuple[Fastest, float]:
        """Return the top speed and turn rates of a robot, and the share by which they may be off."""
        if not self.truth or self.caps.in_process:
            return fastest(self.tracks[robot.id], 0.0, 0.0), 0.0
        window_s = min(_WINDOW_S, 0.25 * self.harness.room_m / self.caps.v_max_m_s)
        return fastest(self.tracks[robot.id], window_s, 0.5 * window_s), _FAST_SHARE

    def trials(self, many: int) -> int:
        """Return how many of `many` trials are worth their time.

        If the truth judges the same motions in all of them, the robot's own samples are judged in a third.
        """
        fleet = self.fleet
        watched = not self.truth and (fleet.truth is not None or self.harness.gives("observe"))
        return -(-many // 3) if watched and not self.caps.in_process else many

    def way_s(self) -> float:
        """Return a generous time for a robot to get anywhere in its room."""
        caps = self.caps
        return 3.0 * self.harness.room_m / self._slow_m_s + 20.0 / caps.yaw_rate_max_rad_s + 2.0 + 4.0 * caps.latency_s

    @property
    def brakes_s(self) -> float:
        """How long a robot may take from its top speed to rest."""
        return self.caps.v_max_m_s / self.caps.brake_m_s2

    @property
    def gains_s(self) -> float:
        """How long a robot may take from rest to its top speed; 0 if it does not promise how it gains speed.

        At most the time for a third of its room: a promise far too small is to be found out, too.
        """
        v_max_m_s, accel_m_s2 = self.caps.v_max_m_s, self.caps.accel_m_s2
        return 0.0 if accel_m_s2 is None else min(v_max_m_s / accel_m_s2, self.harness.room_m / (3.0 * v_max_m_s))

    def orphaned_s(self) -> float:
        """Return how long after the last renewal of its lease a robot at top speed may still move."""
        caps = self.caps
        return caps.lease_s + caps.latency_s + caps.jitter_s + caps.setpoint_period_s + self.brakes_s + TICK_S

    def from_start(self, robot: Robot, target: Waypoint) -> float:
        """Return how far a target is from where a robot started."""
        return math.hypot(target.x_m - robot.spec.x_m, target.y_m - robot.spec.y_m)

    def fail(self, message: str) -> NoReturn:
        """Fail the clause with a message, preceded by the faults that the kit finds in the samples."""
        raise Failed(f"{explain(self)}{message}")

    def require(self, holds: bool, message: str) -> None:
        """Fail the clause with a message unless something holds."""
        if not holds:
            self.fail(message)

    def require_hook(self, hook: str) -> None:
        """Leave the clause untried if the harness does not give an optional hook."""
        if not self.harness.gives(hook):
            raise NotTested(f"not declared: the harness's hook '{hook}'")

    def require_status(self, goal: Goal, status: GoalStatus, cause: str) -> None:
        """Fail the clause unless a goal has a certain status."""
        self.require(
            goal.status is status,
            f"goal {goal.id} is {goal.status.value} ({goal.reason or 'no reason'}), expected {status.value}: {cause}",
        )

    def require_raises(self, kind: type[Exception], call: Callable[[], object], what: str) -> None:
        """Fail the clause unless a call raises a certain error."""
        try:
            call()
        except kind:
            return
        except Exception as other:
            raise Failed(f"{what} raised {type(other).__name__} ({other}), expected {kind.__name__}") from other
        raise Failed(f"{what} raised nothing, expected {kind.__name__}: a public method of Robot is overridden")

    def measure(
        self,
        name: str,
        seen: float,
        bound: float | None = None,
        resolution: float = 0.0,
        cause: str = "",
        *,
        at_least: bool = False,
        spread: Sequence[float] = (),
    ) -> None:
        """Record a figure, and fail the clause if the figure is certain to be beyond its bound.

        Args:
            name: the quantity, with its unit at the end.
            seen: the measured value.
            bound: what the capabilities declare, or allow.
            resolution: how far the measurement itself may be off.
            cause: the likely cause of a figure beyond its bound.
            at_least: the bound is the least that is allowed.
            spread: the values of all trials, if there were several.
        """
        if not self.harness.judges:
            self.figures.append(Figure.of(name, seen, None, resolution, trials=spread))
            return
        figure = Figure.of(name, seen, bound, resolution, at_least=at_least, trials=spread)
        self.figures.append(figure)
        assert bound is None or cause, f"{name}: a figure with a bound is judged by it"
        if not figure.kept:
            word = "declared" if hasattr(self.capabilities, name) else "allowed"
            raise Failed(
                f"{explain(self)}{name} is {seen:.4g}, {word} is {bound:.4g} (measured to {resolution:.2g}): {cause}"
            )
