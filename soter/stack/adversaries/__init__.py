"""Advanced controllers that want harm: they drive all robots, through their ports, at the edges of the rules."""

from soter.stack.adversaries.base import Adversary, AdversaryOptions, Arena, RobotFacts
from soter.stack.adversaries.names import BUILT_IN, MISSION, PREFIX, adversary_class, build_adversary

__all__ = [
    "BUILT_IN",
    "MISSION",
    "PREFIX",
    "Adversary",
    "AdversaryOptions",
    "Arena",
    "RobotFacts",
    "adversary_class",
    "build_adversary",
]
