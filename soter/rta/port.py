"""The port: an untrusted controller's only access to one robot, and the only object here that threads may share."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

C = TypeVar("C")
S = TypeVar("S")

MAX_UPCOMING: Final = 1000
"""Intended commands beyond this number are left out, so that statistics cannot keep the supervisor busy."""


class Request(NamedTuple, Generic[C]):
    """A command in the mailbox.

    Attributes:
        goal_id: the port's number for it, with which its end will be reported.
        command: the command, usually a waypoint.
        upcoming: commands that the controller intends after it; used for statistics only, never for safety.
    """

    goal_id: int
    command: C
    upcoming: tuple[C, ...] = ()


class GoalReport(NamedTuple):
    """How a goal that was requested through a port ended.

    Attributes:
        robot_id: the port's robot.
        goal_id: the goal's number.
        status: reached, superseded, preempted, rejected, cancelled, timed_out or failed.
    """

    robot_id: int
    goal_id: int
    status: str


class ControlReport(NamedTuple):
    """A change of control: the named module took control from the AC, or was the last to give it back."""

    robot_id: int
    engaged: bool
    module: str
    cause: str


Report = GoalReport | ControlReport


class Port(Generic[C, S]):
    """A mailbox with one slot: a newer command replaces one that was not yet taken, so a flood costs nothing.

    `goto` and `put` may be called from any thread. `take`, `report` and `engaged` belong to the supervisor's thread.

    Args:
        robot_id: the robot that it commands.
        listener: called with ended goals and with control lost and regained, in the supervisor's thread; it must only
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
        """Request a command; return the goal's number at once. What becomes of it is reported later.

        Args:
            command: the command, usually a waypoint.
            upcoming: commands intended after it, a plain tuple; anything else is left out, and so are commands
                beyond `MAX_UPCOMING`.
        """
        intended = upcoming[:MAX_UPCOMING] if type(upcoming) is tuple else ()
        with self._lock:
            self._last_goal_id += 1
            self._put(Request(self._last_goal_id, command, intended))
            return self._last_goal_id

    def put(self, request: Request[C]) -> None:
        """Request a command under the caller's own number, which reports repeat; for requests from another port."""
        with self._lock:
            self._put(request)

    def _put(self, request: Request[C]) -> None:
        # A flood must not grow anything: only the newest replaced goal is worth a report.
        if self._slot is not None:
            self._replaced = [self._slot.goal_id]
        self._slot = request

    def take(self) -> Request[C] | None:
        """Empty the mailbox and return its request; report the one that was replaced, if any."""
        if self._slot is None:
            return None
        with self._lock:
            request, self._slot = self._slot, None
            replaced, self._replaced = self._replaced, []
        for goal_id in replaced:
            self._listener(GoalReport(self.robot_id, goal_id, "superseded"))
        return request

    def refuse(self) -> None:
        """Reject the request in the mailbox; one that was made without control must never move the robot later."""
        request = self.take()
        if request is not None:
            self._listener(GoalReport(self.robot_id, request.goal_id, "rejected"))

    def report(self, goal_id: int, status: str) -> None:
        """Report to the listener how a goal ended."""
        self._listener(GoalReport(self.robot_id, goal_id, status))

    def control(self, engaged: bool, module: str, cause: str) -> None:
        """Report to the listener that control was lost or regained."""
        if engaged and not self.engaged:
            # Other threads made these requests since the last tick, without having control.
            self.refuse()
        self.engaged = engaged
        self._listener(ControlReport(self.robot_id, engaged, module, cause))
