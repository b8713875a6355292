"""How a page carries numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.report.page.pack import Columns, buckets, fewest_steps, starts_of_runs
from tests.report.unpacked import Unpacked

NUMBERS = st.lists(st.one_of(st.floats(-1e5, 1e5), st.sampled_from([math.inf, -math.inf, math.nan])), max_size=50)


@given(NUMBERS)
def test_a_column_comes_back_to_half_a_quantum(values: list[float]) -> None:
    columns = Columns()
    number = columns.add(values, 1e-3)
    back = Unpacked(columns.packed({})).column(number)
    assert len(back) == len(values)
    for value, found in zip(values, back, strict=True):
        if math.isfinite(value):
            assert found == pytest.approx(value, abs=0.5e-3 + 1e-9)
        else:
            assert found == value or (math.isnan(found) and math.isnan(value))


def test_columns_do_not_mix() -> None:
    columns = Columns()
    small, large, empty = columns.add([1, 2, 3], 1.0), columns.add([0.0, 1e9, -1e9], 1.0), columns.add([], 1.0)
    back = Unpacked(columns.packed({"said": "✓"}))
    assert back.column(small).tolist() == [1, 2, 3]
    assert back.column(large).tolist() == [0, 1e9, -1e9]
    assert back.column(empty).tolist() == []
    assert back.document["said"] == "✓"


def test_the_widest_jump_that_can_be_counted_is_exact() -> None:
    columns = Columns()
    most = float((1 << 31) - 1)
    number = columns.add([-1e300, 1e300, -most], 1.0)
    assert Unpacked(columns.packed({})).column(number).tolist() == [-most, most, -most]


def test_what_is_too_large_is_cut_without_a_word() -> None:
    columns = Columns()
    number = columns.add([1e308, -1e308, 5.0], 1e-3)
    assert Unpacked(columns.packed({})).column(number).tolist() == pytest.approx([2147483.647, -2147483.647, 5.0])


def test_what_json_cannot_say_is_refused() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        Columns().packed({"margin": math.nan})


def test_steady_motion_is_small() -> None:
    columns = Columns()
    columns.add(np.arange(100_000) * 0.01, 1e-3)
    assert len(columns.packed({})) < 1000


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=100), st.integers(1, 30))
def test_buckets_lose_no_minimum(values: list[float], step: int) -> None:
    low, high = buckets(values, step)
    assert len(low) == -(-len(values) // step)
    for index in range(len(low)):
        part = values[index * step : (index + 1) * step]
        assert (low[index], high[index]) == (min(part), max(part))


def test_buckets_leave_out_what_is_no_number_where_there_is_one() -> None:
    low, high = buckets([math.nan, 1.0, -math.inf, 2.0, math.nan, math.nan], 2)
    assert low[:2].tolist() == [1.0, -math.inf]
    assert high[:2].tolist() == [1.0, 2.0]
    assert math.isnan(low[2])
    assert math.isnan(high[2])
    assert [len(each) for each in buckets([], 3)] == [0, 0]


def test_steps_and_runs() -> None:
    assert [fewest_steps(count, 10) for count in (0, 10, 11, 25)] == [1, 1, 2, 3]
    assert starts_of_runs([0, 0, 1, 1, 0]) == [0, 2, 4]
    assert starts_of_runs([]) == []
