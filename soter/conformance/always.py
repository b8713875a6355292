"""Always: the promises that every sample and every motion must keep, whatever a clause drives the robots for."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from statistics import median
from typing import TYPE_CHECKING, Final

from soter.conformance.track import turn

if TYPE_CHECKING:
    from soter.conformance.judging import Judging
    from soter.sdk import Robot, RobotState

_FASTER: Final = 1.05
_TURNS: Final = 1.1
_GAINS: Final = 1.1
_TURNS_RAD_S: Final = 0.1
_OFF_M: Final = 0.001
_OFF_RAD: Final = 0.05
_LATE_S: Final = 0.1
_LATE_M: Final = 0.01
_SEAM_RAD: Final = 0.5
_AROUND: Final = 6
"""How many samples before a sample, and behind it, show that its velocity is off though the motion is even."""

_EVEN, _ALONE = 0.25, 0.5
_HARDER, _GOT_ON = 3.0, 0.75

_BAD_LINK: Final = "while the link is bad"
_SEAM: Final = "next to pi, where headings begin anew"
_ZEROS: Final = "in samples at (0, 0)"
_TOO_FAST: Final = {
    _BAD_LINK: "speeds are made of two places and the time that should lie between them, whatever was lost or late",
    "": "it keeps what it promises in most that it does, and not in what it was driven for here: a limit that does not "
    "count for this controller, direction or kind of goal",
}
_LONE: Final = (
    "one sample of an even motion is far off the others: a reading that failed is handed out as zeros, or a number is "
    "misread now and then; hand out the last right one"
)
_CAUSES: Final[dict[str, dict[str, str]]] = {
    "v_max_m_s": _TOO_FAST,
    "yaw_rate_max_rad_s": {_SEAM: "it is a difference of headings, and leaps there: take that from -pi to pi"}
    | _TOO_FAST,
    "speed_noise_m_s": {"": _LONE},
    "accel_m_s2": {
        "": "from one sample to the next it gains speed at once: what limits its acceleration counts from what it was "
        "told, and not from its speed, after a stop, the end of a lease or a hand-over"
    },
    "position_noise_m": {
        _ZEROS: "a place that is not known, or not yet since it was switched on, is handed out as zeros: drop that",
        "while it moves": "samples are of an older place than their stamp says, or of a smoothed or foreseen one",
        "": "places are off at rest, too: another frame, unit or origin, another robot's place, or a count that drifts",
    },
    "heading_noise_rad": {
        _SEAM: "a filter, a mean or an interpolation takes pi and -pi for far apart",
        "while it moves": "samples are of an older heading than their stamp says, or of a smoothed or foreseen one",
        "": "headings are off at rest, too: the sign, unit or zero of another frame, or turn rates that are added up",
    },
}
"""By promise: the only occasion on which it was broken, with the likely cause; the key "" is for any occasion."""


class Always:
    """Notes, for each promise, the sample that exceeded it most, as a multiple of the allowed value."""

    def __init__(self) -> None:
        self._worst: dict[str, tuple[float, str]] = {}
        self._only: dict[str, set[str]] = {}
        self._recent: dict[Robot, deque[RobotState]] = {}

    @property
    def wrong(self) -> str:
        """The worst broken promise, with its likely cause; empty if all were kept."""
        if not self._worst:
            return ""
        promise = max(self._worst, key=lambda each: self._worst[each][0])
        when = next(each for each in _CAUSES[promise] if not each or each in self._only[promise])
        return f"{self._worst[promise][1]}{f', only {when}' * bool(when)}: {_CAUSES[promise][when]}"

    def begin(self) -> None:
        """Begin with a fresh fleet, whose samples do not go on from those of the fleet before."""
        self._recent.clear()

    def note(self, bench: Judging, robot: Robot, state: RobotState) -> None:
        """Check a sample that was read just now."""
        caps = robot.capabilities
        link = {_BAD_LINK} if bench.faulty else set[str]()
        noise_m_s = 0.002 + (caps.speed_noise_m_s or 0.02 * caps.v_max_m_s)
        self._keep("v_max_m_s", _speed_m_s(state), _FASTER * caps.v_max_m_s + noise_m_s, robot, link)
        rate_rad_s = caps.yaw_rate_max_rad_s
        seam = {_SEAM} if math.pi - abs(state.heading_rad) < _SEAM_RAD else set[str]()
        turns_rad_s, most_rad_s = abs(state.yaw_rate_rad_s), _TURNS * rate_rad_s + _TURNS_RAD_S
        self._keep("yaw_rate_max_rad_s", turns_rad_s, most_rad_s, robot, link | seam)
        if not bench.faulty:
            self._note_gain(robot, state, noise_m_s)
            self._note_lone(robot, state, noise_m_s)
        truth = bench.fleet.truth
        if truth is None:
            return
        x_m, y_m, heading_rad = truth.pose(robot.id)
        age_s = max(bench.now_s - state.stamp_s, 0.0)
        may_be_m, may_be_rad = caps.position_noise_m + _OFF_M, (caps.heading_noise_rad or 0.0) + _OFF_RAD
        if not caps.in_process:
            # The truth comes over a wire of its own, with its own delay.
            age_s, may_be_m = age_s + caps.jitter_s + _LATE_S, may_be_m + _LATE_M
        off_m, off_rad = math.dist((x_m, y_m), state[3:5]), abs(turn(heading_rad, state.heading_rad))
        when = set() if caps.rests(state) else {"while it moves"}
        if math.pi - abs(heading_rad) < _SEAM_RAD:
            when.add(_SEAM)
        if not any(state[3:5]):
            when.add(_ZEROS)
        self._keep("position_noise_m", off_m, may_be_m + caps.v_max_m_s * age_s, robot, when)
        self._keep("heading_noise_rad", off_rad, may_be_rad + rate_rad_s * age_s, robot, when)

    def _note_gain(self, robot: Robot, state: RobotState, noise_m_s: float) -> None:
        """Check how fast the robot has gained speed since the two samples before, if it promises how fast it may.

        One sample may be wrong, as `_note_lone` sees.
        """
        caps, recent = robot.capabilities, list(self._recent.get(robot, ()))[-2:]
        if caps.accel_m_s2 is None or len(recent) < 2 or state.stamp_s <= recent[-1].stamp_s:
            return
        passed_s = state.stamp_s - recent[0].stamp_s + (0.0 if caps.in_process else caps.jitter_s)
        gained_m_s = _speed_m_s(state) - max(map(_speed_m_s, recent))
        self._keep("accel_m_s2", gained_m_s / passed_s, _GAINS * caps.accel_m_s2 + 2.0 * noise_m_s / passed_s, robot)

    def _note_lone(self, robot: Robot, state: RobotState, noise_m_s: float) -> None:
        """Check the velocity of a sample against those around it, if they show an even motion for one goal."""
        recent = self._recent.setdefault(robot, deque(maxlen=2 * _AROUND + 1))
        if recent and state.stamp_s <= recent[-1].stamp_s:
            return
        recent.append(state)
        if len(recent) <= 2 * _AROUND:
            return
        # Nearly always the sample is like the one before it: this runs at every look.
        off_m_s = abs(_speed_m_s(recent[_AROUND]) - _speed_m_s(recent[_AROUND - 1]))
        if off_m_s <= _EVEN * _ALONE * robot.capabilities.v_max_m_s or any(
            (each.goal_id, each.controller) != (state.goal_id, state.controller) for each in recent
        ):
            return
        before, lone, after = (recent[_AROUND + each] for each in (-1, 0, 1))
        speeds_m_s = [_speed_m_s(each) for each in recent]
        lone_m_s = speeds_m_s.pop(_AROUND)
        even_m_s = median(speeds_m_s)
        off_m_s, passed_s = abs(lone_m_s - even_m_s), after.stamp_s - before.stamp_s
        gap_s = max(lone.stamp_s - before.stamp_s, after.stamp_s - lone.stamp_s)
        if (
            even_m_s > _EVEN * robot.capabilities.v_max_m_s
            and all(abs(each - even_m_s) <= _EVEN * even_m_s for each in speeds_m_s)
            # A robot cannot have stopped, and gone on, so quickly, and has not: it got on as fast as ever.
            and off_m_s > _HARDER * robot.capabilities.brake_m_s2 * gap_s
            and math.dist(before[3:5], after[3:5]) > _GOT_ON * even_m_s * passed_s
        ):
            self._keep("speed_noise_m_s", off_m_s, _ALONE * even_m_s + 2.0 * noise_m_s, robot)

    def _keep(self, promise: str, seen: float, most: float, robot: Robot, when: Collection[str] = ()) -> None:
        times = seen / most
        if times <= 1.0:
            return
        self._only[promise] = self._only.get(promise, {*when}) & {*when}
        if times > self._worst.get(promise, (0.0, ""))[0]:
            said = f"{promise} was {seen:.3g} of robot {robot.id}, allowed at any time is {most:.3g}"
            self._worst[promise] = (times, said)


def _speed_m_s(state: RobotState) -> float:
    return math.hypot(state.vx_m_s, state.vy_m_s)
