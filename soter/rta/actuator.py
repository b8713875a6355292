"""The robot as its supervisor needs it: what stands between `soter.rta` and whatever drives."""

from __future__ import annotations

from typing import Any, Protocol

from soter.controller import Controller
from soter.rta.situation import Sample


class Actuator(Protocol):
    """The robot as the supervisor needs it. Used from the supervisor's thread only."""

    def read(self) -> Sample:
        """Return the latest sample without waiting."""

    def drive(self, command: Any, mode: Controller) -> None:
        """Pass on a command of the controller in charge; None means stop."""

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        """Put another controller in charge; flush what the one before had in flight."""

    def renew(self) -> None:
        """Let the robot move on for another lease."""

    def reported(self, sample: Sample) -> Controller | None:
        """Return who is in charge as the robot itself reports it in a sample; None where it does not report that."""

    def insist(self) -> None:
        """Resend which controller is active: the robot reports another one."""
