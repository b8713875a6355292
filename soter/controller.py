"""Which of a robot's two controllers is meant."""

from __future__ import annotations

from enum import Enum
from typing import TypeVar

_E = TypeVar("_E", bound=type[Enum])


def direct(kind: _E) -> _E:
    """Make the members of an enumeration plain attributes of it, as they are from Python 3.12 on.

    Python 3.11 finds them through a property that is written in Python: ten times as slow, many times a tick.
    """
    for member in kind:
        type.__setattr__(kind, member.name, member)
    return kind


@direct
class Controller(Enum):
    """Who drives: the advanced controller or the safe controller."""

    AC = "AC"
    SC = "SC"

    def __str__(self) -> str:
        return self.value
