"""The workspace as a value: fewer robots, and where a body fits."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.errors import ConfigError
from soter.geometry.workspace import Box, RobotPlace, Workspace

PATCH = Box(0.8, 0.8, 1.2, 1.2, 0.0)
ROOM = Workspace(
    5.0,
    5.0,
    (Box(2, 0, 3, 1), Box(2, 3, 3, 4), Box(1, 2, 1.9, 3)),
    (RobotPlace(1, 1.0, 1.0, PATCH), RobotPlace(2, 2.5, 2.0, PATCH)),
)


def test_fewer_robots_are_the_first_ones() -> None:
    assert [place.id for place in ROOM.with_robots(1).robots] == [1]
    assert ROOM.with_robots(2) == ROOM
    assert ROOM.with_robots(1).boxes == ROOM.boxes


@pytest.mark.parametrize("count", [-1, 0, 3])
def test_other_numbers_of_robots_are_refused(count: int) -> None:
    with pytest.raises(ConfigError, match=rf"{count} robots were asked for, the workspace has 2; allowed: 1 to 2"):
        ROOM.with_robots(count)


@pytest.mark.parametrize(
    ("at", "clearance_m", "expected"),
    [
        ((1.0, 1.0), 0.25, (1.0, 1.0)),  # free as it is
        ((2.0, 2.0), 0.25, (2.15, 2.0)),  # beside the west box
        ((-1.0, 6.0), 0.25, (0.0, 5.0)),  # outside: the corner of the fence
        ((2.5, 0.6), 0.25, (2.5, 1.25)),  # in a box at the fence: out to the north, not below the fence
        ((3.06, 1.08), 0.25, (3.15, 1.2)),  # by a corner: onto the arc around it
    ],
)
def test_nearest_free_point(at: tuple[float, float], clearance_m: float, expected: tuple[float, float]) -> None:
    found = ROOM.nearest_free(*at, clearance_m)
    assert found is not None
    assert found == pytest.approx(expected)


def test_no_free_point() -> None:
    assert Workspace(1.0, 1.0, (Box(0.4, 0.4, 0.6, 0.6),), ()).nearest_free(0.1, 0.1, 0.7) is None


GRID = [(column / 10.0, row / 10.0) for column in range(51) for row in range(51)]
coordinates = st.floats(-1.0, 6.0, allow_nan=False)


@settings(max_examples=50, derandomize=True, deadline=None)
@given(x_m=coordinates, y_m=coordinates, clearance_m=st.sampled_from([0.0, 0.15, 0.255, 0.4]))
def test_nearest_free_point_is_free_and_near(x_m: float, y_m: float, clearance_m: float) -> None:
    found = ROOM.nearest_free(x_m, y_m, clearance_m)
    assert found is not None
    assert ROOM.contains(*found)
    assert ROOM.clearance_m(*found, 0.0) >= clearance_m - 1e-9
    # No free point of a fine grid is nearer. Where outlines cross, ours may be further away than need be, by at most
    # what a square corner has more than a round one.
    best_m = min(math.dist(at, (x_m, y_m)) for at in GRID if ROOM.clearance_m(*at, 0.0) >= clearance_m)
    assert math.dist(found, (x_m, y_m)) <= best_m + 0.42 * clearance_m + 1e-9
