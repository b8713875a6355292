"""Reach models: the most that a margin can fall within a time, under any controller.

`SpeedBound` needs only a top speed and a braking deceleration. The others are tighter for robots that promise more.
All include stopping afterwards, and `reach` never exceeds the model's own `bound`.
"""

from soter.rta.models.base import Directed, Motion, ReachModel, Threat
from soter.rta.models.bounds import DirectedReach, DischargeBound, PairBound, PairsBound, SpeedBound
from soter.rta.models.motion import SpeedAccelerationBound, UnicycleBound
from soter.rta.models.space import PointMassBound

__all__ = [
    "Directed",
    "DirectedReach",
    "DischargeBound",
    "Motion",
    "PairBound",
    "PairsBound",
    "PointMassBound",
    "ReachModel",
    "SpeedAccelerationBound",
    "SpeedBound",
    "Threat",
    "UnicycleBound",
]
