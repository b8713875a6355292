"""Adapters with bugs out of other drivers' issues: protections that latch, and numbers of libraries."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from tests.broken.edits import edited, sampled
from tests.broken.in_process import Broken
from tests.broken.parts import memory, with_control

_STALLS_S: Final = 3.0
_ASKS_M_S, _STANDS_M_S = 0.02, 0.002


def _switches_off(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Stand for good once the wheels were held up for three seconds."""
    now_s, drives_m_s = state[0], state[4]
    kept = memory(robot, "held up", lambda: {"asked": 0.0, "since_s": now_s})
    if abs(kept["asked"]) < _ASKS_M_S or abs(drives_m_s) > _STANDS_M_S:
        kept["since_s"] = now_s
    if now_s - kept["since_s"] > _STALLS_S:
        return 0.0, 0.0
    kept["asked"] = speed
    return speed, rate


SEALED: Final[tuple[type[Broken], ...]] = (
    edited("SwitchesOffForGood", "Drives no more once something has held it up for three seconds.",
           "truth.bounds.body", "switched them off", _connect=with_control(_switches_off)),
    sampled("NumbersOfNumPy", "Numbers the goals of its samples by integers of NumPy.", "state.types", "cannot take it",
            lambda _, state: state._replace(goal_id=None if state.goal_id is None else np.int64(state.goal_id))),
)  # fmt: skip
