"""An advanced controller that takes its process with it."""

from __future__ import annotations

import os

from soter.stack.adversaries import Adversary, AdversaryOptions


class Dies(Adversary[AdversaryOptions]):
    """Ends the process at its first step."""

    def act(self, now_s: float, tick: int) -> None:
        """End it."""
        os._exit(7)
