"""Values that become more while a run goes on, and know which of them have not been told yet."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, MutableSequence
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

S = TypeVar("S", bound=MutableSequence[Any])


class Grown(Generic[S]):
    """A sequence of which only what is new or has changed need be told.

    Args:
        values: the sequence; it is kept, and may be looked at.
    """

    def __init__(self, values: S) -> None:
        self.values: Final = values
        self._told = 0

    def add(self, more: Iterable[Any]) -> None:
        """Append values."""
        self.values.extend(more)

    def set(self, index: int, value: Any) -> None:
        """Change a value; -1 is the last."""
        index %= len(self.values)
        self.values[index] = value
        self._told = min(self._told, index)

    def cut(self, count: int) -> None:
        """Keep only so many."""
        del self.values[count:]
        self._told = min(self._told, count)

    def whole(self) -> tuple[int, S]:
        """Return 0 and all values. What is told to one who comes late is no news for the others."""
        return 0, self.values

    def news(self) -> tuple[int, S]:
        """Return from which index on something was not told yet, and everything from there on; now it is told."""
        since, self._told = self._told, len(self.values)
        return since, self.values[since:]  # type: ignore[return-value]


class Rows(Grown[list[list[Any]]]):
    """Rows of a table."""

    def __init__(self) -> None:
        super().__init__([])


class Numbers(Grown["array[float]"]):
    """A column of numbers."""

    def __init__(self) -> None:
        super().__init__(array("d"))

    def add(self, more: Iterable[float]) -> None:
        self.values.frombytes(np.asarray(more, dtype=np.float64).tobytes())

    def replace(self, numbers: NDArray[np.float64]) -> None:
        """Have other numbers from the first one on."""
        self.cut(0)
        self.add(numbers)
