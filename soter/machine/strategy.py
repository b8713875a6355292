"""How a systematic tester decides what a runtime leaves open."""

from __future__ import annotations

from typing import Protocol


class Strategy(Protocol):
    """Answers every open choice of a run, run after run. ``Runtime(pick=strategy.pick)`` uses it for one run.

    Replaying the numbers that `pick` returned repeats the run exactly, so their list is the run's trace.
    """

    def pick(self, n: int, /) -> int:
        """Choose one of `n` >= 2 possibilities.

        Returns:
            A number from 0 to n - 1.
        """
        ...

    def next_run(self) -> bool:
        """Get ready for the next run.

        Returns:
            False when there is nothing left to explore.
        """
        ...
