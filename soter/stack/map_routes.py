"""The roadmap of a map: places in its free cells, and which pairs of them see each other.

The map is cut into tiles. Every connected part of a tile's free cells is represented by the place with the most room.
Parts that touch are joined by a straight line or, where one does not fit, by the shortest path along the corners of
cells, pulled taut: so the roadmap leads wherever these corners do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from soter.geometry.edges import Floats, Indices

if TYPE_CHECKING:
    from soter.geometry.clearance import Field

_TILES: Final = 600
"""About how many tiles the free cells are cut into."""

_NEAREST: Final = 30
_LEAST_TILE: Final = 16
_LEAST_SHARE: Final = 0.01
"""A connected region smaller than this share of the largest one is noise, or nowhere to go."""

_ROUNDING_M: Final = 1e-9

Labels = NDArray[np.int32]
Corner = tuple[int, int]
"""Column and row of the corner of a cell."""


def map_roads(field: Field, away_m: float, inset_m: float) -> tuple[Floats, Indices]:
    """Return the places of a roadmap, clear of occupied cells and of the edge, and which pairs see each other."""
    # Imported here: only maps need the library, and only while they are prepared.
    from scipy import ndimage

    away_m = max(away_m, 0.0)
    parts = _parts(_free(field, away_m, inset_m))
    # Types of the library differ: there is a part of each number, so none is None.
    found: Any = ndimage.find_objects(parts)
    where: Sequence[tuple[slice, ...]] = found
    nodes = [_roomiest(field, parts, number, each) for number, each in enumerate(where, start=1)]

    def seen(pairs: Sequence[tuple[Corner, Corner]]) -> NDArray[np.bool_]:
        # The edge of a map is a rectangle: of a line, the nearest point to it is one of the ends.
        ends = np.array([[field.grid.corner(*corner) for corner in pair] for pair in pairs]).reshape(-1, 2, 2)
        return field.lines_keep(ends[:, 0], ends[:, 1], away_m - _ROUNDING_M)

    touching = _touching(parts)
    pairs = set()
    sees = seen([(nodes[one], nodes[other]) for one, other in touching])
    for (one, other), straight in zip(touching, sees.tolist(), strict=True):
        if straight:
            pairs.add((one, other))
            continue
        way = _way(parts, where, (one, other), (nodes[one], nodes[other]))
        last, at = one, 0
        while at < len(way) - 1:
            # Go as far along the path as can be seen, and at least one step.
            ahead = np.flatnonzero(seen([(way[at], there) for there in way[at + 2 :]]))
            at = at + 2 + int(ahead[-1]) if ahead.size else at + 1
            then = other if at == len(way) - 1 else len(nodes)
            if then == len(nodes):
                nodes.append(way[at])
            pairs.add((min(last, then), max(last, then)))
            last = then
    near = sorted(_near_pairs(nodes) - pairs)
    sees = seen([(nodes[one], nodes[other]) for one, other in near])
    pairs.update(pair for pair, straight in zip(near, sees.tolist(), strict=True) if straight)
    places = np.array([field.grid.corner(*node) for node in nodes], dtype=np.float64).reshape(-1, 2)
    return places, np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)


def _free(field: Field, away_m: float, inset_m: float) -> NDArray[np.bool_]:
    """Return the corners of cells, by row and column, between which every step keeps its distance."""
    grid = field.grid
    # Between two places h apart, each at least d from all obstacles, the middle is at least sqrt(d^2 - h^2/4) away.
    # The longest steps are diagonals.
    least = math.hypot(away_m / grid.cell_m, math.sqrt(0.5))
    free = field.corners >= least
    rim = max(0, math.ceil(inset_m / grid.cell_m - _ROUNDING_M)) if inset_m > -math.inf else 0
    inside = np.zeros_like(free)
    inside[rim : grid.rows + 1 - rim, rim : grid.columns + 1 - rim] = True
    return free & inside


def _parts(free: NDArray[np.bool_]) -> Labels:
    """Return the number of each corner's part, from 1; 0 for corners that no path may use."""
    from scipy import ndimage

    whole, count = ndimage.label(free)
    sizes = np.bincount(whole.ravel(), minlength=count + 1)
    sizes[0] = 0
    free &= (sizes >= max(1.0, _LEAST_SHARE * sizes.max()))[whole]
    side = max(_LEAST_TILE, math.ceil(math.sqrt(np.count_nonzero(free) / _TILES)))
    rows, columns = (np.arange(count) for count in free.shape)
    # An empty line between tiles separates their parts.
    apart = np.zeros((free.shape[0] + rows[-1] // side, free.shape[1] + columns[-1] // side), dtype=np.bool_)
    at = np.ix_(rows + rows // side, columns + columns // side)
    apart[at] = free
    found: Labels = ndimage.label(apart)[0][at].astype(np.int32)
    return found


def _roomiest(field: Field, parts: Labels, number: int, where: tuple[slice, ...]) -> Corner:
    """Return the corner of a part that is farthest from occupied cells."""
    room = np.where(parts[where] == number, field.corners[where], -1.0)
    row, column = np.unravel_index(int(room.argmax()), room.shape)
    return int(column) + int(where[1].start), int(row) + int(where[0].start)


def _touching(parts: Labels) -> list[tuple[int, int]]:
    """Return the pairs of parts, numbered from 0, that a step along a row or a column joins."""
    found: set[tuple[int, int]] = set()
    for one, other in ((parts[:, :-1], parts[:, 1:]), (parts[:-1], parts[1:])):
        chosen = (one != other) & (one > 0) & (other > 0)
        pairs = np.unique(np.stack([one[chosen], other[chosen]], axis=1), axis=0)
        found |= {(min(a, b) - 1, max(a, b) - 1) for a, b in pairs.tolist()}
    return sorted(found)


def _near_pairs(nodes: Sequence[Corner]) -> set[tuple[int, int]]:
    """Return the pairs of places one of which is among the nearest to the other."""
    from scipy.spatial import KDTree

    if len(nodes) < 2:
        return set()
    places = np.array(nodes)
    _, near = KDTree(places).query(places, k=np.arange(1, min(_NEAREST + 1, len(nodes)) + 1))
    first = np.repeat(np.arange(len(nodes)), near.shape[1])
    pairs = np.sort(np.stack([first, near.ravel()], axis=1), axis=1)
    return {(one, other) for one, other in pairs.tolist() if one != other}


def _way(parts: Labels, where: Sequence[tuple[slice, ...]], numbers: Corner, ends: Sequence[Corner]) -> list[Corner]:
    """Return the shortest path, from corner to corner of cells, through two parts that touch.

    Args:
        parts: the number of each corner's part, from 1.
        where: the rows and columns of every part.
        numbers: the numbers of the two parts, from 0.
        ends: where the path begins and ends.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    low_row, low_column = (min(where[number][axis].start for number in numbers) for axis in (0, 1))
    high_row, high_column = (max(where[number][axis].stop for number in numbers) for axis in (0, 1))
    part = parts[low_row:high_row, low_column:high_column]
    inside = (part == numbers[0] + 1) | (part == numbers[1] + 1)
    index = np.full(inside.shape, -1)
    index[inside] = np.arange(np.count_nonzero(inside))
    steps: list[tuple[NDArray[np.int64], NDArray[np.int64], float]] = []
    for one, other, length in (
        (index[:, :-1], index[:, 1:], 1.0), (index[:-1], index[1:], 1.0),
        (index[:-1, :-1], index[1:, 1:], math.sqrt(2.0)), (index[:-1, 1:], index[1:, :-1], math.sqrt(2.0)),
    ):  # fmt: skip
        both = (one >= 0) & (other >= 0)
        steps.append((one[both], other[both], length))
    lengths = np.concatenate([np.full(len(one), length) for one, _, length in steps])
    rows, columns = (np.concatenate([step[axis] for step in steps]) for axis in (0, 1))
    graph: Any = csr_matrix((lengths, (rows, columns)), shape=(int(index.max()) + 1,) * 2)
    start, end = (int(index[row - low_row, column - low_column]) for column, row in ends)
    _, (before,) = dijkstra(graph, directed=False, indices=[start], return_predecessors=True)
    at_rows, at_columns = np.nonzero(inside)
    way = [end]
    while way[-1] != start:
        way.append(int(before[way[-1]]))
    return [(int(at_columns[each]) + low_column, int(at_rows[each]) + low_row) for each in reversed(way)]
