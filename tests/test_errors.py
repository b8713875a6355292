"""Figures in messages."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from soter.errors import ceil_m, floor_m

length_m = st.floats(-1e4, 1e4)


@given(length_m, st.floats(1e-8, 1.0))
def test_what_falls_short_is_seen_to_and_what_is_copied_from_a_message_does(needed_m: float, short_m: float) -> None:
    found_m = needed_m - short_m
    assert float(floor_m(found_m)) < float(ceil_m(needed_m))
    assert needed_m - 1e-8 <= float(ceil_m(needed_m)) < needed_m + 0.001 + 1e-8
    assert found_m + 1e-8 >= float(floor_m(found_m)) > found_m - 0.001 - 1e-8


def test_a_figure_that_is_exact_is_shown_as_it_is() -> None:
    assert (floor_m(0.3), ceil_m(0.3), floor_m(0.1 + 0.2), ceil_m(0.1 + 0.2)) == ("0.300",) * 4
