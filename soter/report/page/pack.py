"""Packs the numbers of a run for its page: columns of quantised differences, deflated, in base64.

The data are a JSON document and the columns behind it. A column is a first value and the differences between
neighbours, all counted in quanta, in the smallest integers that hold them; a second column flags values that are
infinite or NaN. Steady motion makes small differences, which deflate well.
"""

from __future__ import annotations

import base64
import json
import struct
import zlib
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LEVEL: Final = 9
_MOST: Final = (1 << 31) - 1
# Two neighbours may be the least and the largest countable value; a float holds their difference exactly.
_KINDS: Final = {"i1": (1 << 7) - 1, "i2": (1 << 15) - 1, "i4": _MOST, "f8": 2 * _MOST}

PLUS_INFINITY: Final = 1
MINUS_INFINITY: Final = 2
NO_NUMBER: Final = 3


class Columns:
    """Collects columns, each with a number."""

    def __init__(self) -> None:
        self._heads: Final[list[dict[str, Any]]] = []
        self._data: Final = bytearray()

    def add(self, values: ArrayLike, quantum: float, since: int = 0) -> int:
        """Add a column and return its number.

        Args:
            values: the column's values, clipped to 2^31 quanta.
            quantum: the resolution, in the values' unit; above 0.
            since: how many values of the column were sent before and stay; these ones follow them.
        """
        numbers = np.asarray(values, dtype=np.float64)
        finite = np.isfinite(numbers)
        head: dict[str, Any] = {"count": len(numbers), "quantum": quantum, "first": 0, "since": since}
        if len(numbers):
            # Clipped first: larger values may overflow in the division.
            kept = np.clip(_filled(numbers, finite), -_MOST * quantum, _MOST * quantum)
            counted = np.clip(np.rint(kept / quantum), -_MOST, _MOST).astype(np.int64)
            head["first"] = int(counted[0])
            head["kind"], head["at"] = self._append(np.diff(counted))
            if not finite.all():
                flags = np.select(
                    [finite, np.isposinf(numbers), np.isneginf(numbers)], [0, PLUS_INFINITY, MINUS_INFINITY], NO_NUMBER
                )
                # The same coding again: the flags are a column of small numbers.
                head["flags"] = self.add(flags, 1.0)
        self._heads.append(head)
        return len(self._heads) - 1

    def packed(self, document: dict[str, Any]) -> str:
        """Return a document and all columns as text for a page."""
        text = json.dumps({**document, "columns": self._heads}, separators=(",", ":"), allow_nan=False).encode()
        whole = struct.pack("<I", len(text)) + text + bytes(self._data)
        return base64.b64encode(zlib.compress(whole, _LEVEL)).decode("ascii")

    def _append(self, differences: NDArray[np.int64]) -> tuple[str, int]:
        largest = int(np.abs(differences).max(initial=0))
        kind = next(name for name, most in _KINDS.items() if largest <= most)
        at = len(self._data)
        self._data.extend(differences.astype(f"<{kind}").tobytes())
        return kind, at


def fewest_steps(count: int, most: int) -> int:
    """Return how many neighbours a bucket has to gather so that there are at most `most` buckets."""
    return max(1, -(-count // most))


def buckets(values: ArrayLike, step: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the largest value of every `step` neighbours; NaN only if all of them are NaN."""
    numbers = np.asarray(values, dtype=np.float64)
    starts = np.arange(0, len(numbers), step)
    if not len(starts):
        return numbers, numbers
    return np.fmin.reduceat(numbers, starts), np.fmax.reduceat(numbers, starts)


def starts_of_runs(values: Iterable[int]) -> list[int]:
    """Return the first index, and those at which a value differs from the one before."""
    numbers = np.fromiter(values, dtype=np.int64)
    return [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist()] if len(numbers) else []


def _filled(numbers: NDArray[np.float64], finite: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the numbers with each non-finite one replaced by the last finite one, so that differences stay small."""
    if finite.all():
        return numbers
    last = np.maximum.accumulate(np.where(finite, np.arange(len(numbers)), 0))
    filled = numbers[last]
    return np.where(np.isfinite(filled), filled, 0.0)
