"""Which robots are near enough to matter to each other; the cost grows linearly with their number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from soter.rta.situation import Sample

if TYPE_CHECKING:
    from soter.rta.supervisor import RobotSupervisor

FEW = 6
"""Up to so many robots, everybody is everybody's peer: cheaper than sorting them."""


class Neighbours:
    """Sorts robots into square cells as wide as the radius, and takes a cell's and its eight neighbours' as peers.

    Args:
        radius_m: robots nearer than this are always peers; some farther ones are too. If it is infinite, all are.
    """

    def __init__(self, radius_m: float) -> None:
        self._per_m = 1.0 / radius_m

    def assign(
        self, robots: Sequence[RobotSupervisor], samples: Sequence[Sample], others: Sequence[Sample] = ()
    ) -> None:
        """Refresh `situation.peers` of every robot.

        Args:
            robots: whose situations.
            samples: of each of them.
            others: of robots that are not among them, peers of all that are.
        """
        count = len(robots)
        if count <= FEW:
            for index, robot in enumerate(robots):
                robot.situation.peers = (*samples[:index], *samples[index + 1 :], *others)
            return
        per_m, floor = self._per_m, math.floor
        cells: dict[tuple[int, int], list[Sample]] = {}
        places = []
        for sample in samples:
            place = (floor(sample.x_m * per_m), floor(sample.y_m * per_m))
            places.append(place)
            cells.setdefault(place, []).append(sample)
        for robot, sample, (column, row) in zip(robots, samples, places, strict=True):
            peers = []
            for near_column in (column - 1, column, column + 1):
                for near_row in (row - 1, row, row + 1):
                    members = cells.get((near_column, near_row))
                    if members:
                        peers += members
            peers.remove(sample)
            peers += others
            robot.situation.peers = peers
