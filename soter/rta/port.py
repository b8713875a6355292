"""The port: one untrusted controller's rights on one robot, and the only object here that threads may share."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

C = TypeVar("C")
S = TypeVar("S")

MAX_UPCOMING: Final = 1000
"""What a controller intends beyond so many commands is left out: statistics must not keep the supervisor busy."""


class Request(NamedTuple, Generic[C]):
    """A command in the mailbox.

    Attributes:
        goal_id: the port's number for it, by which its end will be reported.
        command: what is asked for.
        upcoming: what the controller intends after it; used for statistics only, never for safety.
    """

    goal_id: int
    command: C
    upcoming: tuple[C, ...] = ()


class GoalReport(NamedTuple):
    """How a goal that was asked for through a port ended.

    Attributes:
        robot_id: whose port.
        goal_id: which goal.
        status: the interface's word for it: reached, superseded, preempted, rejected, cancelled, timed_out, failed.
    """

    robot_id: int
    goal_id: int
    status: str


class ControlReport(NamedTuple):
    """The robot changed hands: the module took control from the AC, or was the last to give it back."""

    robot_id: int
    engaged: bool
    module: str
    cause: str


Report = GoalReport | ControlReport


class Port(Generic[C, S]):
    """A mailbox of one slot: a newer command replaces one that was not yet taken, so a flood costs nothing.

    `goto` and `put` may be called from any thread. `take`, `report` and `engaged` belong to the supervisor's thread.

    Args:
        robot_id: whose port.
        listener: told of ended goals and of control lost and regained, in the supervisor's thread; it must only
            pass the report on.

    Attributes:
        engaged: whether the AC has control.
        state: the robot's latest sample; an immutable value, replaced at every tick.
    """

    def __init__(self, robot_id: int, listener: Callable[[Report], None]) -> None:
        self.robot_id = robot_id
        self.engaged = False
        self.state: S | None = None
        self._listener = listener
        self._lock = threading.Lock()
        self._slot: Request[C] | None = None
        self._replaced: list[int] = []
        self._last_goal_id = 0

    def goto(self, command: C, upcoming: tuple[C, ...] = ()) -> int:
        """Ask for a place; return the goal's number at once. Whether it moves anything is reported later.

        Args:
            command: what is asked for.
            upcoming: what is intended after it, a plain tuple; anything else is left out, as is what is beyond
                `MAX_UPCOMING`.
        """
        intended = upcoming[:MAX_UPCOMING] if type(upcoming) is tuple else ()
        with self._lock:
            self._last_goal_id += 1
            self._put(Request(self._last_goal_id, command, intended))
            return self._last_goal_id

    def put(self, request: Request[C]) -> None:
        """Ask under a number of the caller's own, which reports will repeat: for what comes from another port."""
        with self._lock:
            self._put(request)

    def _put(self, request: Request[C]) -> None:
        # A flood must not grow anything: only the newest replaced goal is worth a report.
        if self._slot is not None:
            self._replaced = [self._slot.goal_id]
        self._slot = request

    def take(self) -> Request[C] | None:
        """Empty the mailbox; tells the owner of a command that was replaced in it."""
        if self._slot is None:
            return None
        with self._lock:
            request, self._slot = self._slot, None
            replaced, self._replaced = self._replaced, []
        for goal_id in replaced:
            self._listener(GoalReport(self.robot_id, goal_id, "superseded"))
        return request

    def refuse(self) -> None:
        """Empty the mailbox while the AC has no control: what was asked for then must never move anything later."""
        request = self.take()
        if request is not None:
            self._listener(GoalReport(self.robot_id, request.goal_id, "rejected"))

    def report(self, goal_id: int, status: str) -> None:
        """Tell the owner how a goal ended."""
        self._listener(GoalReport(self.robot_id, goal_id, status))

    def control(self, engaged: bool, module: str, cause: str) -> None:
        """Tell the owner that control was lost or has come back."""
        if engaged and not self.engaged:
            # What other threads have asked for since the last tick, they asked for without having control.
            self.refuse()
        self.engaged = engaged
        self._listener(ControlReport(self.robot_id, engaged, module, cause))
