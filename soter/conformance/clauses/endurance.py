"""Endurance: what shows only after a while, or seldom."""

from __future__ import annotations

import gc
import math
from collections import deque
from itertools import pairwise
from statistics import median
from typing import Final

from soter.conformance.bench import SETTLE_S, Bench
from soter.conformance.clause import clause
from soter.conformance.driver import ROUNDING, TICK_S
from soter.conformance.track import quantile
from soter.conformance.trials import ToAndFro
from soter.conformance.usage import usage
from soter.sdk import Robot, RobotState

_LASTS_S: Final = 75.0
"""What happens once a minute happens in this time."""

_ROUNDS: Final = 3
_REST_M: Final = 2e-4
_GROWS_MIB: Final = 0.25
_GROWS_S: Final = 0.01
_LEAST: Final = 0.01
_KEPT: Final = 20
_MANY: Final = 200


@clause("endurance.minute")
def minute(bench: Bench) -> None:
    """In more than a minute of driving no goal is taken late, places do not drift, and the memory taken stays."""
    robot = bench.open_one()
    commands, held, ages_s = _Commands(bench, robot), [_memory_mib()], []
    for _ in range(_ROUNDS):
        commands.drive(_LASTS_S / _ROUNDS)
        held.append(_memory_mib())
        ages_s.append(median(commands.ages_s))
    bench.measure(
        "age_growth_s", ages_s[-1] - ages_s[0], _GROWS_S, bench.read_s,
        f"in {_LASTS_S:.0f} s samples have grown older by so much: the vehicle's clock is slow, and is not followed",
    )  # fmt: skip
    # On a wire one may be the host's; what is the robot's comes again.
    excused = 0 if bench.caps.in_process else 1
    if sum(each > bench.caps.latency_s + bench.fit_s for each in commands.late_s()) == excused == 1:
        commands.drive(_LASTS_S)
    late_s = commands.late_s()
    if len(late_s) > excused:
        bench.measure(
            "command_rare_s", sorted(late_s)[-1 - excused], bench.caps.latency_s, bench.fit_s,
            f"of {len(late_s)} goals some were taken late: now and then the robot, or the wire, does something else "
            "first", spread=late_s,
        )  # fmt: skip
    commands.shuttle.goal.cancel()
    bench.run(SETTLE_S)
    state = bench.look(robot).state
    if bench.fleet.truth is not None or bench.harness.gives("observe"):
        bench.measure(
            "position_drift_m", math.dist((state.x_m, state.y_m), bench.true_pose(robot.id)[:2]),
            bench.caps.position_noise_m, _REST_M,
            f"at rest after {_LASTS_S:.0f} s of driving its place is off: it counts wheels and loses count, or its "
            "scale is wrong",
        )  # fmt: skip
    grown = [after - before for before, after in pairwise(each for each in held if each is not None)]
    bench.measure(
        "memory_mib", min(grown, default=0.0), _GROWS_MIB, 0.0,
        f"in every {_LASTS_S / _ROUNDS:.0f} s the process takes more memory: messages are kept",
    )  # fmt: skip


class _Commands:
    """Sends a goal at every tick, and takes note of when samples name it.

    Attributes:
        shuttle: drives.
        took_s: from each goto to the stamp of the first sample that names it, or one after it.
        ages_s: how old the last samples were when they were read.
    """

    def __init__(self, bench: Bench, robot: Robot) -> None:
        self.shuttle: Final = ToAndFro(bench, robot)
        self.took_s: Final[list[float]] = []
        self._bench: Final = bench
        self._robot: Final = robot
        self._sent: Final[deque[tuple[int, float]]] = deque()
        self._gaps_s: Final[deque[float]] = deque(maxlen=_MANY)
        self._state: RobotState = robot.read_state()
        self._looked_s = self._said_s = bench.now_s
        self.ages_s: Final[deque[float]] = deque(maxlen=_MANY)

    def drive(self, seconds: float) -> None:
        """Go on for so long."""
        self._looked_s = self._bench.now_s
        self._sent.clear()
        self._bench.run(seconds, self._look, closely=True)

    def late_s(self) -> list[float]:
        """Return how late each was taken, at least.

        A command takes no less than no time, and what else is in these times differs by no more than from one sample to
        the next: those that took least say how much it is, whatever the host did to the others.
        """
        least_s = quantile(self.took_s, _LEAST) + median(self._gaps_s) if self.took_s else 0.0
        return [max(took_s - least_s, 0.0) for took_s in self.took_s]

    def _look(self) -> bool:
        bench, now_s = self._bench, self._bench.now_s
        track = bench.tracks[self._robot.id]
        del track[:-_KEPT]
        before, self._state = self._state, track[-1].state
        gap_s = self._state.stamp_s - before.stamp_s
        if now_s - self._looked_s > 2.0 * TICK_S or gap_s > 2.0 * median(self._gaps_s or [gap_s]) + bench.read_s:
            # The host stood still, here or there, and what was under way meanwhile says nothing of the robot.
            self._sent.clear()
        self._looked_s = now_s
        self.ages_s.append(now_s - self._state.stamp_s)
        if gap_s > 0.0:
            self._gaps_s.append(gap_s)
            named = self._state.goal_id
            while named is not None and self._sent and self._sent[0][0] <= named:
                self.took_s.append(self._state.stamp_s - self._sent.popleft()[1])
        if now_s - self._said_s >= TICK_S - ROUNDING:
            self._said_s = now_s
            self.shuttle.go_on(anew=True)
            self._sent.append((self.shuttle.goal.id, now_s))
        return False


def _memory_mib() -> float | None:
    gc.collect()
    used = usage()
    return None if used is None else used.memory_mib
