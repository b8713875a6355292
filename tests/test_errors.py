"""Figures in messages, and what is an interruption."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.errors import ceil_m, floor_m, is_interruption

length_m = st.floats(-1e4, 1e4)


@given(length_m, st.floats(1e-8, 1.0))
def test_what_falls_short_is_seen_to_and_what_is_copied_from_a_message_does(needed_m: float, short_m: float) -> None:
    found_m = needed_m - short_m
    assert float(floor_m(found_m)) < float(ceil_m(needed_m))
    assert needed_m - 1e-8 <= float(ceil_m(needed_m)) < needed_m + 0.001 + 1e-8
    assert found_m + 1e-8 >= float(floor_m(found_m)) > found_m - 0.001 - 1e-8


def test_a_figure_that_is_exact_is_shown_as_it_is() -> None:
    assert (floor_m(0.3), ceil_m(0.3), floor_m(0.1 + 0.2), ceil_m(0.1 + 0.2)) == ("0.300",) * 4


class OfAWatchdog(KeyboardInterrupt):
    """What a watchdog raises by a signal of its own."""


@pytest.fixture
def ctrl_c(request: pytest.FixtureRequest) -> Iterator[None]:
    before = signal.signal(signal.SIGINT, request.param)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("ctrl_c", [signal.default_int_handler], indirect=True)
def test_ctrl_c_and_a_watchdog_interrupt_and_no_failure_does() -> None:
    assert is_interruption(KeyboardInterrupt())
    assert is_interruption(OfAWatchdog())
    assert not is_interruption(SystemExit())


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("ctrl_c", [signal.SIG_IGN], indirect=True)
def test_where_ctrl_c_is_ignored_code_has_raised_it_itself() -> None:
    assert not is_interruption(KeyboardInterrupt())
    assert is_interruption(OfAWatchdog())
