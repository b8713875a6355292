"""The leg to a target, and the points on it that vehicles without gate, lease and headings are sent to."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from soter.adapters.mavlink.frames import wrapped_rad
from soter.sdk import RobotState, Waypoint

_SHORT_M: Final = 1e-6
_AHEAD_RAD: Final = 0.05
_WORTH_A_TURN_M: Final = 0.15
_ALONG_RAD: Final = 0.5
_HAS_COURSE_M: Final = 0.3
_PIVOTS_RAD: Final = 0.3
_FACES_RAD: Final = 0.1
_NOISES: Final = 3.0


class TargetLeg(NamedTuple):
    """The straight leg to a target; targets no further ahead than the lease covers are the dead man of such vehicles.

    A real autopilot drives on to its last target even if the sender is gone. So it is given a point on the leg, as far
    ahead as the vehicle may still go without hearing more, and a new one with every renewal. When SOTER falls silent
    the vehicle comes to rest there.
    """

    x_m: float
    y_m: float
    z_m: float
    target: Waypoint

    @property
    def backwards(self) -> bool:
        """Whether the robot arrives closer to the requested heading if it drives the leg backwards."""
        return self._off_rad() > 0.5 * math.pi

    @property
    def along(self) -> bool:
        """Whether the leg, driven forwards or backwards, ends with the requested heading without a turn.

        A short leg may be at an angle to it: the robot's position became known a little after the heading was chosen.
        """
        length_m = math.hypot(self.target.x_m - self.x_m, self.target.y_m - self.y_m)
        slant_rad = _ALONG_RAD if length_m > _HAS_COURSE_M else math.inf
        return length_m > _SHORT_M and min(self._off_rad(), math.pi - self._off_rad()) <= slant_rad

    def _off_rad(self) -> float:
        target = self.target
        if target.heading_rad is None:
            return 0.0
        course_rad = math.atan2(target.y_m - self.y_m, target.x_m - self.x_m)
        return abs(wrapped_rad(target.heading_rad - course_rad))

    def ended(self, at: RobotState, noise_m: float) -> bool:
        """Return whether the robot is at the target, as far as the noise of positions lets that be known.

        A rover that is a little beside a place, and is sent there, turns round in place and goes there. So one that is
        to arrive with a heading, and has been there from the start, is not there yet.
        """
        target = self.target
        # Both the start of the leg and the position now may be off by the noise.
        near_m = 2.0 * noise_m
        if math.hypot(target.x_m - at.x_m, target.y_m - at.y_m) > min(near_m, target.radius_m):
            return False
        return target.heading_rad is None or math.hypot(target.x_m - self.x_m, target.y_m - self.y_m) > near_m

    def looking_ahead(self, at: RobotState) -> Waypoint:
        """Return a copter's target for now: first a turn on the spot towards the target, then the target itself.

        So a copter looks where it flies. A target with a heading, or one quite near, is returned as it is.
        """
        target = self.target
        dx_m, dy_m = target.x_m - self.x_m, target.y_m - self.y_m
        if target.heading_rad is not None or math.hypot(dx_m, dy_m) < _WORTH_A_TURN_M:
            return target
        course_rad = math.atan2(dy_m, dx_m)
        gone_m = math.hypot(at.x_m - self.x_m, at.y_m - self.y_m)
        if abs(wrapped_rad(course_rad - at.heading_rad)) > _AHEAD_RAD and gone_m < _WORTH_A_TURN_M:
            return target._replace(x_m=self.x_m, y_m=self.y_m, z_m=self.z_m, heading_rad=course_rad)
        return target._replace(heading_rad=course_rad)

    def ahead(self, at: RobotState, reach_m: float) -> tuple[float, float, float]:
        """Return the point on the leg that is `reach_m` ahead of a vehicle, or the target if that is nearer."""
        dx_m, dy_m, dz_m = self.target.x_m - self.x_m, self.target.y_m - self.y_m, self.target.z_m - self.z_m
        length_m = math.hypot(dx_m, dy_m, dz_m)
        if length_m < _SHORT_M:
            return self.target.x_m, self.target.y_m, self.target.z_m
        gone = (at.x_m - self.x_m) * dx_m + (at.y_m - self.y_m) * dy_m + (at.z_m - self.z_m) * dz_m
        share = min(max(gone / length_m, 0.0) + reach_m, length_m) / length_m
        return self.x_m + share * dx_m, self.y_m + share * dy_m, self.z_m + share * dz_m

    def facing(
        self, at: RobotState, place: tuple[float, float, float], noise_m: float, most_rad: float, *, turns: bool
    ) -> float | None:
        """Return a rover's heading for now if it has to turn in place before it drives to a place; else None.

        A rover that is sent to such a place ends its turn, and then drives there, however long it hears nothing more.

        Args:
            at: where the rover is.
            place: on the leg.
            noise_m: of positions; the way to a near place may lead anywhere.
            most_rad: how far from its present heading it may be told to turn.
            turns: whether it is turning already: then it goes on until it looks there.
        """
        dx_m, dy_m = place[0] - at.x_m, place[1] - at.y_m
        if math.hypot(dx_m, dy_m) <= max(_NOISES * noise_m, _SHORT_M):
            return None
        course_rad = math.atan2(dy_m, dx_m) + (math.pi if self.backwards else 0.0)
        off_rad = wrapped_rad(course_rad - at.heading_rad)
        if abs(off_rad) <= (_FACES_RAD if turns else _PIVOTS_RAD):
            return None
        return wrapped_rad(at.heading_rad + min(max(off_rad, -most_rad), most_rad))


def towards(at: RobotState, place: tuple[float, float, float], ahead_m: float) -> tuple[float, float, float]:
    """Return the point that is `ahead_m` from a rover towards a place of its leg, or the place if that is nearer.

    The leg itself may be as far beside a rover as such a point is ahead of it: a slow one would turn to and fro.
    """
    away_m = math.dist((at.x_m, at.y_m), place[:2])
    share = ahead_m / away_m if away_m > ahead_m else 1.0
    return at.x_m + share * (place[0] - at.x_m), at.y_m + share * (place[1] - at.y_m), place[2]


def reach_m(v_m_s: float, brake_m_s2: float, lease_left_s: float) -> float:
    """Return how far ahead a target may be: the distance driven in the rest of the lease, plus the braking distance."""
    return v_m_s * lease_left_s + v_m_s * v_m_s / (2.0 * brake_m_s2)
