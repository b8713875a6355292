"""OFFBOARD, PX4's mode for targets: it begins, and lasts, only while set-points keep coming.

Written after PX4's documentation of the mode, not after what one was seen to do.
"""

from __future__ import annotations

from math import inf
from typing import Final

_EVERY_S: Final = 0.5
"""Set-points have to come more often than twice a second."""

_BEFORE_S: Final = 1.0
"""For so long they have to have come before the mode begins."""


class Offboard:
    """Whether the set-points of one vehicle keep coming, from whomever. Times are the vehicle's own, in seconds."""

    def __init__(self) -> None:
        self._since_s = inf
        self._last_s = -inf

    def hear(self, now_s: float) -> None:
        """Note a set-point."""
        if now_s - self._last_s > _EVERY_S:
            self._since_s = now_s
        self._last_s = now_s

    def may_begin(self, now_s: float) -> bool:
        """Return whether they have come for long enough."""
        return now_s - self._last_s <= _EVERY_S and now_s - self._since_s >= _BEFORE_S

    def lost(self, now_s: float, loss_s: float) -> bool:
        """Return whether none has come for the time that the vehicle waits for one."""
        return now_s - self._last_s > loss_s
