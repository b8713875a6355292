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
        self._told: Final[dict[tuple[object, ...], object]] = {}

    def look(self, now_s: float) -> Iterator[Event]:
        """Yield events for all that is new since the look before."""
        if self._truth is not None:
            for each in self._truth.report().violations:
                if self._is_news(("violation", each.rule, each.robots, each.start_s), each.end_s is not None):
                    yield ViolationEvent(now_s, each.rule, each.robots, each.start_s, _absent_if_none(each.end_s))
        for index, fault in enumerate(self._faults()):
            if fault.affected and self._is_news(("fault", index), fault.affected):
                yield FaultEvent(now_s, fault.robot_id, fault.kind, fault.declared, fault.affected)
        for stall in self._stalls():
            if self._is_news(("stall", stall.robot_id, stall.start_s), stall.end_s is not None):
                end_s = _absent_if_none(stall.end_s)
                yield StallEvent(now_s, stall.robot_id, stall.start_s, stall.module, stall.cause, end_s)
        for robot in self._robots:
            for assumption, spell in robot.log.spells.items():
                if self._is_news(("breach", robot.robot_id, assumption), (spell.first_s, spell.times)):
                    yield BreachEvent(
                        now_s, robot.robot_id, assumption.id, spell.first_s, spell.last_s, spell.times, spell.cause,
                        tuple(WorstMessage(*each) for each in spell.worst),
                    )  # fmt: skip

    def _is_news(self, key: tuple[object, ...], told: object) -> bool:
        before, self._told[key] = self._told.get(key), told
        return before != told


def _absent_if_none(end_s: float | None) -> float | msgspec.UnsetType:
    return msgspec.UNSET if end_s is None else end_s
