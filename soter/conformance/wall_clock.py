"""The host's wall clock as this process reads it, which a clause sets without setting that of the host."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_TIME, _TIME_NS = time.time, time.time_ns
_SET_S: Final = [0.0]


def _time() -> float:
    return _TIME() + _SET_S[0]


def _time_ns() -> int:
    return _TIME_NS() + round(1e9 * _SET_S[0])


def take_over() -> None:
    """Have `time.time` and `time.time_ns` show what was set; before the adapter is imported, which may keep them."""
    time.time, time.time_ns = _time, _time_ns


@contextmanager
def taken_over() -> Iterator[None]:
    """Take over for a while, in whichever process; then all is as before."""
    before = time.time, time.time_ns
    take_over()
    try:
        yield
    finally:
        set_by(0.0)
        time.time, time.time_ns = before


def set_by(seconds: float) -> None:
    """Set the wall clock, as this process reads it, by so much from the host's."""
    _SET_S[0] = seconds
