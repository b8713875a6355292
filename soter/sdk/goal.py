"""Handles of goals and of changes of control. Only the robot's base class writes them, inside `read_state()`."""

from __future__ import annotations

from collections.abc import Callable

from soter.sdk.values import Controller, GoalStatus, Waypoint


class Goal:
    """One `goto` call, and how it ended.

    Attributes:
        id: unique within the robot's life.
        target: the waypoint to go to.
        by: the controller that requested it.
        sent_s: fleet time of the call.
        status: ACTIVE until it ends, then its final status.
        reason: why it ended so, in words; empty while active.
        ended_s: fleet time at which it ended, or None.
    """

    __slots__ = ("_cancel", "by", "deadline_s", "ended_s", "id", "radius_sq_m2", "reason", "sent_s", "status", "target")

    def __init__(
        self, cancel: Callable[[Goal], None], goal_id: int, target: Waypoint, by: Controller, sent_s: float
    ) -> None:
        self._cancel = cancel
        self.id = goal_id
        self.target = target
        self.by = by
        self.sent_s = sent_s
        self.deadline_s = sent_s + target.timeout_s
        self.radius_sq_m2 = target.radius_m * target.radius_m
        self.status = GoalStatus.ACTIVE
        self.reason = ""
        self.ended_s: float | None = None

    @property
    def active(self) -> bool:
        """Whether the goal has not ended yet."""
        return self.status is GoalStatus.ACTIVE

    def cancel(self) -> None:
        """End this goal as CANCELLED. The robot stops, even at a reached goal, unless it was sent another one since."""
        self._cancel(self)

    def _end(self, status: GoalStatus, reason: str, now_s: float) -> None:
        if self.status is GoalStatus.ACTIVE:
            self.status, self.reason, self.ended_s = status, reason, now_s

    def __repr__(self) -> str:
        return f"Goal({self.id}, {self.by}, ({self.target.x_m:.3f}, {self.target.y_m:.3f}), {self.status.value})"


class Switch:
    """One change of the active controller, or a renewal of its lease.

    Attributes:
        to: the controller that is to be active.
        reason: why control changes.
        requested_s: fleet time of the call.
        effective_s: when the old controller's stream was shut and the new one could command; None until then.
        confirmed_s: when the robot's own report showed the change; None until then, or if the robot does not report it.
    """

    __slots__ = ("confirmed_s", "effective_s", "reason", "requested_s", "to")

    def __init__(self, to: Controller, reason: str, requested_s: float) -> None:
        self.to = to
        self.reason = reason
        self.requested_s = requested_s
        self.effective_s: float | None = None
        self.confirmed_s: float | None = None
