"""A simulated world of ground robots, for every backend: in process, or behind a wire."""

from soter_sim.bodies import (
    BODY_RADIUS_M,
    LIMITS,
    Bodies,
    Control,
    stand_still,
)
from soter_sim.engine import MOST_BOXES, Engine, EngineFactory, boxes_of_map
from soter_sim.impairment import Impairment
from soter_sim.truth import WorldTruth
from soter_sim.world import ENGINES, World, in_window

__all__ = [
    "BODY_RADIUS_M",
    "ENGINES",
    "LIMITS",
    "MOST_BOXES",
    "Bodies",
    "Control",
    "Engine",
    "EngineFactory",
    "Impairment",
    "World",
    "WorldTruth",
    "boxes_of_map",
    "in_window",
    "stand_still",
]
