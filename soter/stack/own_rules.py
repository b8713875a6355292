"""Rules of the user's own, as every safe controller keeps them: nothing is known of them but their margin."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from soter.rta import Region, Sample, Situation

_PARTS: Final = (0.5, 1.0)
"""Of a leg, where the margin is asked for."""


class OwnRule(NamedTuple):
    """What a module of the user's own keeps.

    Attributes:
        region: its phi_safe.
        of_pairs: whether peers use up its margin as well.
    """

    region: Region
    of_pairs: bool

    def allows(self, situation: Situation, bx_m: float, by_m: float, off_m: float, peer_m: float) -> bool:
        """Return whether the rule holds along the leg to b wherever the robot strays from it, or gets no worse.

        It is asked as if the robot were there already, as fast as it is now. A rule that fails allows no leg; why it
        fails is said by its decision module, which fails on it as well.

        Args:
            situation: of the robot.
            bx_m: the leg's end, east.
            by_m: the leg's end, north.
            off_m: how far the robot may stray.
            peer_m: how far a peer may come nearer before this robot sees it.
        """
        try:
            least = self._least(situation, peer_m)
            places = _places(situation.own, bx_m, by_m, off_m)
            # Written so that a margin that is not a number allows nothing.
            return all(self.region.margin(_moved(situation, *place)) >= least for place in places)
        except Exception:  # noqa: BLE001 - foreign code must not take the shipped safe controllers along
            return False

    def _least(self, situation: Situation, peer_m: float) -> float:
        margin = self.region.margin(situation)
        if self.of_pairs and margin > 0.0:
            # Half of it is the peer's, which may be on its way.
            return min(margin, margin / 2.0 + peer_m)
        return min(0.0, margin)


class _Moved:
    """A sample of a robot as if it were elsewhere."""

    def __init__(self, own: Sample, x_m: float, y_m: float) -> None:
        self._own: Final = own
        self.x_m: Final = x_m
        self.y_m: Final = y_m

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own, name)


def _places(own: Sample, bx_m: float, by_m: float, off_m: float) -> list[tuple[float, float]]:
    """Return where the robot may be on its way to b: half-way and at the end, and off both to the sides and ahead."""
    dx, dy = bx_m - own.x_m, by_m - own.y_m
    length_m = math.hypot(dx, dy) or 1.0
    ux, uy = dx / length_m, dy / length_m
    return [
        (own.x_m + part * dx + ahead_m * ux - left_m * uy, own.y_m + part * dy + ahead_m * uy + left_m * ux)
        for part in _PARTS
        for ahead_m, left_m in ((0.0, 0.0), (0.0, off_m), (0.0, -off_m), (off_m, 0.0))
    ]


def _moved(situation: Situation, x_m: float, y_m: float) -> Situation:
    there = Situation(situation.robot_id, _Moved(situation.own, x_m, y_m), situation.now_s)
    there.peers = situation.peers
    return there
