"""Which of a robot's two controllers is meant."""

from __future__ import annotations

from enum import Enum


class Controller(Enum):
    """Who drives: the advanced controller or the safe controller."""

    AC = "AC"
    SC = "SC"

    def __str__(self) -> str:
        return self.value
