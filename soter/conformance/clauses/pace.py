"""Pace: the loop that drives a robot keeps running, and not only the one that receives and sends."""

from __future__ import annotations

import math
from array import array
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.lateness import Regularity
from soter.conformance.track import TURNING_RAD_S, TrackSample
from soter.conformance.trials import ToAndFro
from soter.sdk import Robot

_LASTS_S: Final = 60.0
_SLOWER: Final = 0.55
_EVEN: Final = 0.25
_GIVES_UP_S: Final = 1.0
_FEW: Final = 20
_TOWARDS: Final = 0.9


@clause("endurance.pace")
def pace(bench: Bench) -> None:
    """In a minute of driving faster and slower in turn no goal changes the speed late."""
    robot = bench.open_one()
    even_m_s = _EVEN * (1.0 - _SLOWER) * bench.caps.v_max_m_s
    if 2.0 * bench.speed_noise_m_s > even_m_s:
        raise NotTested("not declared: a speed_noise_m_s small enough to see speeds change")
    changes = _Changes(bench, robot, even_m_s)
    bench.run(_LASTS_S, changes.look, closely=True)
    # On a wire one late change may be due to the host; a fault of the robot's shows again.
    excused = 0 if bench.caps.in_process else 1
    if sum(each > changes.most_s + changes.off_s for each in changes.late_s()) == excused == 1:
        bench.run(_LASTS_S, changes.look, closely=True)
    late_s = changes.late_s()
    if len(late_s) < _FEW:
        raise NotTested(f"{len(late_s)} changes of speed in {_LASTS_S:g} s say little: {_FEW} would do, in more room")
    bench.measure(
        "speed_rare_s", sorted(late_s)[-1 - excused], changes.most_s, changes.off_s,
        f"of {len(late_s)} goals that change its speed some change it late: now and then what drives stands still, "
        "while what hears and talks goes on, or it does something else first", spread=late_s,
    )  # fmt: skip


class _Changes:
    """Makes a robot drive faster and slower in turn, and records how soon it does.

    Args:
        bench: the clause's bench.
        robot: the robot to drive.
        even_m_s: how far a speed may be from what was asked for to count as even.

    Attributes:
        most_s: how late a change may be.
        off_s: how far a measured lateness may be off.
    """

    def __init__(self, bench: Bench, robot: Robot, even_m_s: float) -> None:
        caps, by_m_s = bench.caps, (1.0 - _SLOWER) * bench.caps.v_max_m_s
        self.most_s: Final = caps.latency_s + caps.jitter_s
        self.off_s: Final = bench.fit_s + 2.0 * bench.speed_noise_m_s / caps.brake_m_s2
        self._bench: Final = bench
        self._robot: Final = robot
        self._shuttle: Final = ToAndFro(bench, robot)
        self._speeds_m_s: Final = (_SLOWER * caps.v_max_m_s, caps.v_max_m_s)
        self._even_m_s: Final = even_m_s
        shortest_s = self.most_s + caps.sample_age_s + by_m_s / min(caps.brake_m_s2, caps.accel_m_s2 or math.inf)
        self._every_s: Final = TICK_S * math.ceil(shortest_s / TICK_S)
        self._free_m: Final = caps.v_max_m_s * (self._every_s + TICK_S) + caps.v_max_m_s**2 / (2.0 * caps.brake_m_s2)
        # For the slower and the faster speed: from each goto to the stamp of the first sample closer to that speed.
        self._took_s: Final = (array("d"), array("d"))
        self._fast, self._sent_s = 1, math.nan
        self._due_s = bench.now_s
        self._regular: Final = Regularity(bench, bench.look(robot).at_s)

    def late_s(self) -> list[float]:
        """Return by how much each change was late at least."""
        return [each for took_s in self._took_s for each in self._regular.late_s(took_s)]

    def look(self) -> bool:
        """Record a change, and make the next one if it is due; return False, so that driving goes on."""
        now_s, at = self._bench.now_s, self._bench.tracks[self._robot.id][-1]
        if self._regular.broken(at.at_s):
            self._sent_s = math.nan
        nearer_to_faster = at.speed_m_s > sum(self._speeds_m_s) / 2.0
        if at.at_s > self._sent_s and nearer_to_faster == bool(self._fast):
            self._note(at.at_s)
        if now_s - self._sent_s > self.most_s + _GIVES_UP_S:
            self._note(now_s)
        if now_s >= self._due_s and math.isnan(self._sent_s):
            self._change(now_s, at)
        return False

    def _note(self, at_s: float) -> None:
        if self._sent_s < at_s:
            self._took_s[self._fast].append(at_s - self._sent_s)
        self._sent_s = math.nan

    def _change(self, now_s: float, at: TrackSample) -> None:
        end, even = self._shuttle.end, abs(at.speed_m_s - self._speeds_m_s[self._fast]) <= self._even_m_s
        self._fast, self._due_s = 1 - self._fast, now_s + self._every_s - ROUNDING
        self._shuttle.go_on(anew=True, speed_m_s=self._speeds_m_s[self._fast])
        # A robot that brakes for its target, or turns to the next, changes its speed by itself.
        left_m = at.distance_m(end.x_m, end.y_m)
        turns = abs(at.state.yaw_rate_rad_s) > TURNING_RAD_S
        free = self._shuttle.end is end and left_m - end.radius_m > self._free_m and not turns
        gets_m_s = ((end.x_m - at.x_m) * at.state.vx_m_s + (end.y_m - at.y_m) * at.state.vy_m_s) / max(left_m, 1e-9)
        self._sent_s = now_s if even and free and gets_m_s > _TOWARDS * at.speed_m_s else math.nan
