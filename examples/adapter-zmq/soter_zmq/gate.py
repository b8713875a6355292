"""Who may move a robot, and for how long: the robot's own side of authority and dead man."""

from __future__ import annotations

import math

from soter_zmq.wire import LEASE_S, Command, GoalMessage


class Gate:
    """Takes commands and passes on the goal that may move the robot now.

    It follows one session, and another only when the lease of that one is dead. The lease counts from the time at
    which the renewal was sent, so that what was on its way for long, or waited in a buffer, renews nothing.

    Attributes:
        session: who commands; empty before the first command.
        seq: number of the last command taken.
        controller: who is in charge, "AC" or "SC".
        goal: the goal of the controller in charge, or None.
    """

    def __init__(self) -> None:
        self.session = ""
        self.seq = 0
        self.controller = "SC"
        self.goal: GoalMessage | None = None
        self._renewed_s = -math.inf

    def take(self, command: Command, now_s: float) -> bool:
        """Take a command at the robot's time `now_s`; return False, and change nothing, if it is not to be followed."""
        if command.session != self.session:
            if self.alive(now_s):
                return False
            self._renewed_s = -math.inf
        elif command.seq <= self.seq:
            return False
        self.session, self.seq = command.session, command.seq
        if command.controller != self.controller:
            # A change of hands drops what the other had in flight, whatever else the command says.
            self.controller, self.goal = command.controller, None
        goal = command.goal
        if goal is None:
            self.goal = None
        elif goal.by == self.controller and goal != self.goal:
            self.goal = goal
        if command.lease_s is None:
            self._renewed_s = -math.inf
        else:
            # A sender whose idea of this clock runs ahead must not thereby get a longer lease.
            self._renewed_s = max(self._renewed_s, min(command.lease_s, now_s))
        return True

    def alive(self, now_s: float) -> bool:
        """Return whether the lease lives."""
        return 0.0 <= now_s - self._renewed_s < LEASE_S

    def passing(self, now_s: float) -> GoalMessage | None:
        """Return the goal that may move the robot now, or None: stop."""
        return self.goal if self.alive(now_s) else None
