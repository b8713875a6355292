"""Polls the parts of a run that last (violations, faults, assumptions, stalls) and yields their news as events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from soter.record.messages import BreachEvent, Event, FaultEvent, StallEvent, ViolationEvent, WorstMessage
from soter.rta import RobotSupervisor
from soter.sdk import FaultReport, Truth

LOOK_S: Final = 1.0
"""Fleet time between two looks; shorter than the gap between two spells of a failed assumption, to miss none."""


@dataclass(frozen=True, slots=True)
class Stall:
    """A long time in which a robot was without its AC, and not charging.

    Attributes:
        start_s: fleet time at which it began.
        end_s: fleet time at which it ended; None while it goes on.
        module: the module whose safe controller drove the robot at the latest look.
        cause: why that module had fired, in words.
    """

    robot_id: int
    start_s: float
    end_s: float | None
    module: str
    cause: str


class Looks:
    """Polls ground truth, faults, assumptions and stalls of one run."""

    def __init__(
        self,
        robots: Sequence[RobotSupervisor] = (),
        truth: Truth | None = None,
        faults: Callable[[], Sequence[FaultReport]] = tuple,
        stalls: Callable[[], Sequence[Stall]] = tuple,
    ) -> None:
        self._robots: Final = tuple(robots)
        self._truth: Final = truth
        self._faults: Final = faults
        self._stalls: Final = stalls
        self._ended: Final[dict[tuple[object, ...], bool]] = {}
        self._counted: Final[dict[tuple[object, ...], tuple[float, int]]] = {}

    def look(self, now_s: float) -> Iterator[Event]:
        """Yield events for all that is new since the look before."""
        if self._truth is not None:
            for each in self._truth.report().violations:
                if self._is_news(("violation", each.rule, each.robots, each.start_s), each.end_s):
                    yield ViolationEvent(now_s, each.rule, each.robots, each.start_s, _absent_if_none(each.end_s))
        for index, fault in enumerate(self._faults()):
            if self._is_more(("fault", index), 0.0, fault.affected):
                yield FaultEvent(now_s, fault.robot_id, fault.kind, fault.declared, fault.affected)
        for stall in self._stalls():
            if self._is_news(("stall", stall.robot_id, stall.start_s), stall.end_s):
                end_s = _absent_if_none(stall.end_s)
                yield StallEvent(now_s, stall.robot_id, stall.start_s, stall.module, stall.cause, end_s)
        for robot in self._robots:
            for assumption, spell in robot.log.spells.items():
                if self._is_more(("breach", robot.robot_id, assumption), spell.first_s, spell.times):
                    yield BreachEvent(
                        now_s, robot.robot_id, assumption.id, spell.first_s, spell.last_s, spell.times, spell.cause,
                        tuple(WorstMessage(*each) for each in spell.worst),
                    )  # fmt: skip

    def _is_news(self, key: tuple[object, ...], end_s: float | None) -> bool:
        ended = end_s is not None
        before, self._ended[key] = self._ended.get(key), ended
        return before is not ended

    def _is_more(self, key: tuple[object, ...], since_s: float, count: int) -> bool:
        before, self._counted[key] = self._counted.get(key, (0.0, 0)), (since_s, count)
        return before != (since_s, count)


def _absent_if_none(end_s: float | None) -> float | msgspec.UnsetType:
    return msgspec.UNSET if end_s is None else end_s
