"""Handles of what was asked of a robot. Only the robot's base class writes them, inside `read_state()`."""

from __future__ import annotations

from collections.abc import Callable

from soter.sdk.values import Controller, GoalStatus, Waypoint


class Goal:
    """One goto and how it ended.

    Attributes:
        id: unique within the robot's life.
        target: where to.
        by: which controller asked.
        sent_s: fleet time of the call.
        status: ACTIVE until it ends, then for ever what it ended as.
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
        """Whether the robot still works on it."""
        return self.status is GoalStatus.ACTIVE

    def cancel(self) -> None:
        """End this goal, and no other, as CANCELLED; the robot stops if it was sent no other since, reached or not."""
        self._cancel(self)

    def _end(self, status: GoalStatus, reason: str, now_s: float) -> None:
        if self.status is GoalStatus.ACTIVE:
            self.status, self.reason, self.ended_s = status, reason, now_s

    def __repr__(self) -> str:
        return f"Goal({self.id}, {self.by}, ({self.target.x_m:.3f}, {self.target.y_m:.3f}), {self.status.value})"


class Switch:
    """One change of the controller in charge, or a renewal of its lease.

    Attributes:
        to: who is to be in charge.
        reason: why.
        requested_s: fleet time of the call.
        effective_s: when the old controller's stream was shut and the new one could command; None until then.
        confirmed_s: when the robot's own report showed it; None until then, or where robots do not report it.
    """

    __slots__ = ("confirmed_s", "effective_s", "reason", "requested_s", "to")

    def __init__(self, to: Controller, reason: str, requested_s: float) -> None:
        self.to = to
        self.reason = reason
        self.requested_s = requested_s
        self.effective_s: float | None = None
        self.confirmed_s: float | None = None
