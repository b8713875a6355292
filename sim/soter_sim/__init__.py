"""A simulated world of ground robots, for every backend: in process, or behind a wire."""

from soter_sim.bodies import (
    BODY_RADIUS_M,
    LIMITS,
    Bodies,
    Control,
    stand_still,
)
from soter_sim.engine import Engine, EngineFactory
from soter_sim.impairment import Impairment
from soter_sim.truth import WorldTruth
from soter_sim.world import ENGINES, World, in_window

__all__ = [
    "BODY_RADIUS_M",
    "ENGINES",
    "LIMITS",
    "Bodies",
    "Control",
    "Engine",
    "EngineFactory",
    "Impairment",
    "World",
    "WorldTruth",
    "in_window",
    "stand_still",
]
