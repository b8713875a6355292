"""Reach models: the most that a margin can fall within a time, under any controller.

`SpeedBound` needs nothing but a top speed and a brake. The others are tighter where the robot promises more about
itself; all of them include stopping afterwards, and none of them is ever more than its own `bound`.
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
