"""The interface between a robot's supervisor and whatever drives the robot."""

from __future__ import annotations

from typing import Any, Protocol

from soter.controller import Controller
from soter.rta.situation import Sample


class Actuator(Protocol):
    """What the supervisor needs of a robot. Used from the supervisor's thread only."""

    def read(self) -> Sample:
        """Return the latest sample without waiting."""

    def drive(self, command: Any, mode: Controller) -> None:
        """Pass on a command of the active controller; None means stop."""

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        """Make another controller the active one; drop what the previous one had in flight."""

    def renew(self) -> None:
        """Let the robot move on for another lease."""

    def reported(self, sample: Sample) -> Controller | None:
        """Return the active controller that the robot reports in a sample; None if it reports none."""

    def insist(self) -> None:
        """Resend which controller is active; called when the robot reports another one."""
