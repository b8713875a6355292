"""ACs that end the process that they are in, or that fail as no AC may."""

from __future__ import annotations

import os
from pathlib import Path

from soter.controllers.adversaries import Adversary


class Dies(Adversary):
    """Ends its process at once, without a word."""

    def act(self, now_s: float, tick: int) -> None:
        os._exit(3)


class DiesOnce(Adversary):
    """Does so where there is no file `SOTER_TEST_DIED` yet, and makes it."""

    def act(self, now_s: float, tick: int) -> None:
        mark = Path(os.environ["SOTER_TEST_DIED"])
        if not mark.exists():
            mark.touch()
            os._exit(3)
