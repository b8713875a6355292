"""The mux: chooses between two controllers on the robot, and stops it when the lease is dead."""

from __future__ import annotations

from math import inf
from typing import Final, Generic, TypeVar

C = TypeVar("C")
"""A controller's name, such as `soter.sdk.Controller` or a MAVLink component id."""

T = TypeVar("T")
"""A controller's command, such as a goal or a velocity."""

# Equal times may differ by rounding; a lease must not live a whole period longer because of it.
_ROUNDING_S: Final = 1e-6


class Mux(Generic[C, T]):
    """Passes the command of the active controller, while its lease lives.

    The lease begins dead: nothing moves before the first renewal. A command is held while the lease is dead and
    passes again once it is renewed, because only the supervisor that judged the robot safe renews it. Not thread-safe.

    Args:
        in_charge: the controller that is active at first.
        lease_s: a lease dies this long after its last renewal, in vehicle time.
        command_s: a command dies this long after it was given; infinite for goals, short for velocities.
    """

    __slots__ = ("_given_s", "_renewed_s", "_seen_s", "command", "command_s", "in_charge", "lease_s")

    def __init__(self, in_charge: C, lease_s: float, command_s: float = inf) -> None:
        for name, value in (("lease_s", lease_s), ("command_s", command_s)):
            if not value > 0.0:
                raise ValueError(f"{name} is {value}, allowed: above 0")
        self.in_charge = in_charge
        self.lease_s = lease_s
        self.command_s = command_s
        self.command: T | None = None
        self._given_s = -inf
        self._renewed_s = -inf
        self._seen_s = -inf

    def give(self, by: C, command: T, now_s: float) -> bool:
        """Take a controller's command; return False, and change nothing, if the controller is not active."""
        if by != self.in_charge:
            return False
        self.command = command
        self._given_s = now_s
        return True

    def switch(self, to: C) -> bool:
        """Make a controller active; return whether that is a change, which drops the other's command."""
        if to == self.in_charge:
            return False
        self.in_charge = to
        self.command = None
        return True

    def renew(self, now_s: float) -> None:
        """Let the robot move for another `lease_s` of vehicle time."""
        self._renewed_s = now_s
        if now_s > self._seen_s:
            self._seen_s = now_s

    def halt(self) -> None:
        """Drop the command; the active controller stays active, and its lease lives on."""
        self.command = None

    def revoke(self) -> None:
        """Drop the command and end the lease at once."""
        self.command = None
        self._renewed_s = -inf

    def alive(self, now_s: float) -> bool:
        """Return whether the lease lives. A clock that goes back (a reboot) ends it, for good."""
        if now_s < self._seen_s - _ROUNDING_S:
            # Otherwise the lease would live on, or live again when the clock shows that time once more.
            self._renewed_s = -inf
        self._seen_s = now_s
        return -_ROUNDING_S <= now_s - self._renewed_s < self.lease_s - _ROUNDING_S

    def passing(self, now_s: float) -> T | None:
        """Return the command that may move the robot now, or None to stop."""
        return self.command if self.alive(now_s) and now_s - self._given_s < self.command_s else None
