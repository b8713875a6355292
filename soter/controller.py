"""Which of a robot's two controllers is meant."""

from __future__ import annotations

from enum import Enum
from typing import Final


class Controller(Enum):
    """Who drives: the advanced controller or the safe controller."""

    AC = "AC"
    SC = "SC"

    def __str__(self) -> str:
        return self.value


AC: Final = Controller.AC
SC: Final = Controller.SC
"""For what runs in every tick: in Python 3.11 a member costs ten times as much to find in its class as a name does."""
