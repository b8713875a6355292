"""Hostile controllers that drive all robots, through their ports, at the edges of the rules."""

from soter.controllers.adversaries.base import Adversary, AdversaryOptions

__all__ = ["Adversary", "AdversaryOptions"]
