"""A change of state of a machine as it is recorded, wherever the machine runs."""

from __future__ import annotations

from typing import Final

from soter.machine import Transition
from soter.record.messages import Transition as TransitionMessage

DETAIL_CHARACTERS: Final = 200


def in_words(transition: Transition) -> TransitionMessage:
    """Return a transition as it is recorded."""
    event, machine = transition.event, transition.machine
    return TransitionMessage(
        transition.time_s, machine.name, machine.id, machine.node, transition.source or "", transition.target or "",
        "" if event is None else type(event).__name__, "" if event is None else repr(event)[:DETAIL_CHARACTERS],
    )  # fmt: skip
