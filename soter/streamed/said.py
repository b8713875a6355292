"""The velocities that were asked for of late, by which those of others are told from them."""

from __future__ import annotations

from collections import deque
from typing import Final

KEPT_S: Final = 1.0
"""A mux passes nothing on that is older, wherever it waited."""

_ROUNDING: Final = 1e-6


class Said:
    """What a mux may pass on. Any threads."""

    def __init__(self) -> None:
        self._said: Final[deque[tuple[float, float, float]]] = deque(maxlen=400)

    def note(self, forward_m_s: float, turn_rad_s: float, now_s: float) -> None:
        """Note a velocity that was asked for."""
        self._said.append((now_s, forward_m_s, turn_rad_s))

    def explains(self, forward_m_s: float, turn_rad_s: float, now_s: float) -> bool:
        """Return whether a velocity is rest, or one that was asked for of late, which a mux may have limited."""
        if not forward_m_s and not turn_rad_s:
            return True
        return any(
            now_s - then_s <= KEPT_S and _within(forward_m_s, forward) and _within(turn_rad_s, turn)
            for then_s, forward, turn in self._said.copy()
        )


def _within(passed: float, asked: float) -> bool:
    return min(0.0, asked) - _ROUNDING <= passed <= max(0.0, asked) + _ROUNDING
