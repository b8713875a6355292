"""How late a robot obeys commands, with the host's own delays taken out."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from statistics import median
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.driver import TICK_S
from soter.conformance.track import quantile

_LEAST: Final = 0.01
_MANY: Final = 200


class Regularity:
    """Watches how regularly the bench looks at a robot, and its samples arrive."""

    def __init__(self, bench: Bench, stamp_s: float) -> None:
        self._bench: Final = bench
        self._gaps_s: Final[deque[float]] = deque(maxlen=_MANY)
        self._looked_s, self._stamp_s = bench.now_s, stamp_s

    def begin(self) -> None:
        """Begin to watch now."""
        self._looked_s = self._bench.now_s

    def broken(self, stamp_s: float) -> bool:
        """Take the stamp of the latest sample; return whether this host or the vehicle's has paused before it.

        Commands under way during a pause say nothing about the robot.
        """
        now_s, gap_s = self._bench.now_s, stamp_s - self._stamp_s
        usual_s = median(self._gaps_s or [gap_s])
        late = now_s - self._looked_s > 2.0 * TICK_S or gap_s > 2.0 * usual_s + self._bench.read_s
        self._looked_s, self._stamp_s = now_s, stamp_s
        if gap_s > 0.0:
            self._gaps_s.append(gap_s)
        return late

    def late_s(self, took_s: Sequence[float]) -> list[float]:
        """Return by how much each command of one kind was late at least, given how long each took.

        Times also contain a constant overhead, which differs by no more than the interval of samples. The shortest
        times show that overhead, whatever the host did to the others.
        """
        least_s = quantile(took_s, _LEAST) + median(self._gaps_s) if took_s else 0.0
        return [max(each - least_s, 0.0) for each in took_s]
