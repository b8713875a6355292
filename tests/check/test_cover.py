"""A cover leaves out no state, and says which ones it could not prove."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.check import OUTSIDE, Cell, Judged, Status, cover


def disc(cell: Cell) -> Judged:
    """Proves that points are within 1 m of (1, 1), for the claim of all that are within 0.7 m of it."""
    far_m = math.dist((cell.x_m, cell.y_m), (1.0, 1.0))
    if far_m - cell.radius_m > 0.7:
        return OUTSIDE
    return Judged(Status.PROVED, far_m + cell.radius_m) if far_m + cell.radius_m <= 1.0 else Judged(Status.UNKNOWN)


def test_a_claim_with_room_to_spare_is_proved() -> None:
    found = cover(2.0, 2.0, disc)
    assert found.complete
    assert found.share == 1.0
    assert 0.7 <= found.cost <= 1.0


def test_a_claim_that_is_false_somewhere_is_not_proved_there() -> None:
    def judge(cell: Cell) -> Judged:
        low, high = cell.x_m - cell.half_m, cell.x_m + cell.half_m
        return Judged(Status.PROVED) if high <= 0.55 or low >= 0.65 else Judged(Status.UNKNOWN, 0.0, "too near")

    found = cover(1.0, 1.0, judge)
    assert not found.complete
    assert all(0.5 <= cell.x_m <= 0.7 for cell, _ in found.unknown)
    assert {why for _, why in found.unknown} == {"too near"}
    assert found.proved_m2 + found.unknown_m2 == pytest.approx(1.0)
    assert found.least_side_m <= 0.0125


@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0))
def test_every_state_lies_in_a_cell_that_was_judged(x_m: float, y_m: float) -> None:
    inside = [
        cell for cell in cover(2.0, 2.0, disc).proved
        if abs(cell.x_m - x_m) <= cell.half_m + 1e-9 and abs(cell.y_m - y_m) <= cell.half_m + 1e-9
    ]  # fmt: skip
    assert inside or math.dist((x_m, y_m), (1.0, 1.0)) > 0.7
    assert all(math.dist((x_m, y_m), (cell.x_m, cell.y_m)) <= cell.radius_m + 1e-9 for cell in inside)


def test_a_claim_about_nothing_is_not_complete() -> None:
    found = cover(1.0, 1.0, lambda cell: OUTSIDE)
    assert not found.complete
    assert found.share == 0.0


@pytest.mark.parametrize("least_side_m", [0.0, 0.3, math.nan])
def test_cells_that_cannot_be(least_side_m: float) -> None:
    with pytest.raises(ValueError, match="least_side_m"):
        cover(1.0, 1.0, disc, 0.2, least_side_m)
