"""The interface of reach models, and what direction-aware models need of a region."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Final, NamedTuple, Protocol

from soter.rta.assumptions import Assumption
from soter.rta.situation import Sample, Situation

ROUNDING_M: Final = 1e-9
"""Largest rounding error of the arithmetic that tests a sample."""


class ReachModel(ABC):
    """Bounds how far a margin falls within T, R(T), and tests whether a new sample fits the model.

    A model whose bound depends on the state overrides `reach`; `bound` must then be its maximum over all states.
    """

    assumption: ClassVar[Assumption] = Assumption.MOTION
    """The assumption that is broken when a sample is not admitted."""

    @property
    def of_pairs(self) -> bool:
        """Whether the margin is between this robot and others, so that the others' motion counts as well."""
        return False

    @abstractmethod
    def bound(self, time_s: float) -> float:
        """Return R(T) for the worst state, in the unit of the margin; it includes stopping afterwards."""

    def reach(self, situation: Situation, time_s: float) -> float:
        """Return R(T) from this very state, never more than `bound(time_s)`."""
        return self.bound(time_s)

    @property
    def depends_on_state(self) -> bool:
        """Whether `reach` may be less than `bound`."""
        return type(self).reach is not ReachModel.reach

    def of_own(self) -> ReachModel:
        """Return the part of the model that is about this robot alone; this robot's samples are tested against it."""
        return self

    @abstractmethod
    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        """Return whether `after` lies in the reach set of `before`; if not, the model is wrong about this robot."""

    def excess(self, before: Sample, after: Sample, noise_m: float) -> tuple[float, str]:
        """Return by how much a sample that is not admitted lies outside, and the unit; NaN if the model cannot say."""
        return math.nan, ""


class Motion(ReachModel):
    """How far one robot gets, in metres: a reach model of any margin that falls by at most one metre per metre driven.

    For a margin that falls in one direction only, `extent` is the tighter bound; see `DirectedReach`.
    """

    def extent(self, sample: Sample, time_s: float, ux: float, uy: float, uz: float = 0.0) -> float:
        """Return how far the robot gets in a direction within a time, stopping included; at most `bound(time_s)`.

        It is the support function of the set of all places that the robot can pass, relative to where it is now.

        Args:
            sample: where it is now, and how it moves.
            time_s: for how long any controller may drive, before the robot is told to stop.
            ux: the direction east, of unit length with the other two.
            uy: the same, north.
            uz: the same, up.
        """
        return self.bound(time_s)


class Threat(NamedTuple):
    """One part of a margin, and the direction in which it falls.

    Attributes:
        margin: the part's own margin; the region's margin is the least of its parts'.
        ux: the direction in which it falls fastest, east; of unit length with the other two.
        uy: the same, north.
        uz: the same, up.
        peer: the robot whose motion in the opposite direction lowers it as well; None for a part that no peer lowers.
    """

    margin: float
    ux: float
    uy: float
    uz: float = 0.0
    peer: Sample | None = None


class Directed(Protocol):
    """A region that knows in which directions its margin falls.

    For every part, however the robot moves by d and its peer by e, the part's margin never falls by more than
    u.d - u.e. This holds for the distance to a plane, to a convex body and to another robot.
    """

    def margin(self, situation: Situation) -> float:
        """Return the margin."""

    def threats(self, situation: Situation) -> Sequence[Threat]:
        """Return all parts that may become the least; a part that is left out must stay above the others."""
