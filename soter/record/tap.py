"""Writes down what passes between a supervisor and its robot, and changes none of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

from msgspec import UNSET

from soter.record.messages import Goal as GoalMessage
from soter.record.wire import Way
from soter.rta import Actuator, Mode, Request, Sample
from soter.sdk import Goal, GoalStatus

LONGEST_WAY: Final = 100
"""Places of an AC's way that are recorded; it is untrusted, and may be of any length."""


class GoalActuator(Actuator, Protocol):
    """An actuator that tells which goal it has sent."""

    @property
    def goal(self) -> Goal | None:
        """The goal that was asked for last; None once it has ended."""


class Tap:
    """An `Actuator` in front of a robot's own.

    Args:
        robot_id: which robot.
        inner: its actuator.
        note: takes goals and ways.

    Attributes:
        unread: whether there was no sample at this tick.
        no_state: why there was none.
        refused: calls that failed at this tick, and the failures.
        ac_drove: whether a command of the AC has passed at this tick.
    """

    __slots__ = ("_goal", "_inner", "_note", "_now_s", "_robot_id", "ac_drove", "no_state", "refused", "unread")

    def __init__(self, robot_id: int, inner: GoalActuator, note: Callable[[GoalMessage | Way], None]) -> None:
        self._robot_id: Final = robot_id
        self._inner: Final = inner
        self._note: Final = note
        self._goal: Goal | None = None
        self.unread = False
        self.no_state = ""
        self.refused: list[tuple[str, str]] = []
        self.ac_drove = False

    def read(self) -> Sample:
        try:
            sample = self._inner.read()
        except Exception as failure:
            self.unread, self.no_state = True, str(failure)
            raise
        # Goals begin elsewhere; looked at here at every tick, they only end.
        goal = self._goal
        if goal is not None and goal.status is not GoalStatus.ACTIVE:
            self._look()
        return sample

    def drive(self, command: Any, mode: Mode) -> None:
        if isinstance(command, Request):
            self.ac_drove = True
        try:
            self._inner.drive(command, mode)
        except Exception as failure:
            self.refused.append(("drive", repr(failure)))
            raise
        finally:
            self._look(command)

    def hand_over(self, mode: Mode, module: str, cause: str) -> None:
        try:
            self._inner.hand_over(mode, module, cause)
        except Exception as failure:
            self.refused.append(("hand_over", repr(failure)))
            raise
        finally:
            self._look()

    def renew(self) -> None:
        try:
            self._inner.renew()
        except Exception as failure:
            self.refused.append(("renew", repr(failure)))
            raise

    def reported(self, sample: Sample) -> Mode | None:
        return self._inner.reported(sample)

    def insist(self) -> None:
        try:
            self._inner.insist()
        except Exception as failure:
            self.refused.append(("insist", repr(failure)))
            raise

    def _look(self, command: Any = None) -> None:
        """Note that a goal has begun or ended."""
        before, goal = self._goal, self._inner.goal
        if before is not None and before.status is not GoalStatus.ACTIVE:
            self._goal = None
            if before.status is not GoalStatus.SUPERSEDED:
                self._note(self._message(before))
        if goal is None or goal is before or goal is self._goal:
            return
        self._goal = goal
        # What is not active any more has not been acted upon: its end is all there is to say.
        if goal.status is GoalStatus.ACTIVE:
            self._note(self._message(goal))
            if isinstance(command, Request):
                self._note_way(goal, command)

    def _note_way(self, goal: Goal, request: Request[Any]) -> None:
        places = [(goal.target.x_m, goal.target.y_m)]
        for waypoint in request.upcoming[: LONGEST_WAY - 1]:
            try:
                places.append((float(waypoint.x_m), float(waypoint.y_m)))
            except (AttributeError, TypeError, ValueError, OverflowError):
                break
        self._note(Way(goal.sent_s, self._robot_id, places))

    def _message(self, goal: Goal) -> GoalMessage:
        target = goal.target
        ended = goal.status is not GoalStatus.ACTIVE
        return GoalMessage(
            goal.sent_s if goal.ended_s is None else goal.ended_s, self._robot_id, goal.id, goal.by.value,
            goal.status.value, float(target.x_m), float(target.y_m), float(target.z_m),
            UNSET if target.heading_rad is None else float(target.heading_rad),
            UNSET if target.speed_m_s is None else float(target.speed_m_s),
            goal.reason if ended else "",
        )  # fmt: skip
