"""The gate of robots that drive to goals by themselves."""

from __future__ import annotations

import math
import secrets
from typing import Final

from soter.onboard.command import Command, GoalMessage
from soter.onboard.gate import Gate
from soter.onboard.wire import Order

_BACK_S: Final = 0.02
"""A clock that loses more than this against steady time, from one call to the next, was set back."""


class GoalGate(Gate[GoalMessage]):
    """Takes commands and passes on the goal that may move the robot now. Not thread-safe.

    A lease lives by steady time, and counts from its renewal, by the robot's own clock. That clock has a name: commands
    with another name, from before the robot was switched on or before its clock was set back, renew nothing.
    """

    def __init__(self, lease_s: float) -> None:
        super().__init__(lease_s)
        self._clock = secrets.token_hex(4)
        self._ahead_s = -math.inf

    def obey(self, command: Command, clock_s: float, now_s: float) -> bool:
        """Take a command; return False, and change nothing, if it must not be followed.

        `clock_s` is the time of the robot's clock that stamps its reports, and `now_s` is steady time.
        """
        same, renewed_s = self.clock(clock_s, now_s) == command.clock, command.renewed_s
        age_s = clock_s - renewed_s if same and renewed_s is not None else None
        if not self.take(Order(command.session, command.seq, command.controller, renewed_s), age_s, now_s):
            return False
        goal = command.goal
        if goal is None:
            self.halt()
        elif goal != self.command:
            # A repeated goal stays the same object, so that the drive does not begin anew.
            self.give(goal.by, goal, now_s)
        return True

    def clock(self, clock_s: float, now_s: float) -> str:
        """Return the name of the robot's clock: a new one if the clock was set back since the last call.

        To be called for every report; the arguments are those of `obey`.
        """
        ahead_s = clock_s - now_s
        if ahead_s < self._ahead_s - _BACK_S:
            self._clock = secrets.token_hex(4)
        self._ahead_s = ahead_s
        return self._clock
