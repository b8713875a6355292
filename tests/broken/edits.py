"""Broken adapters by small edits of right ones: a name, what is wrong, the clause that finds out, what it blames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from soter.sdk import Goal, Robot, RobotState, Waypoint
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.conformance.wire import Vehicle

B = TypeVar("B", bound=type)


def _made(base: B, name: str, says: str, caught_by: str, blames: str, parts: Mapping[str, object]) -> B:
    parts = {**parts, "__doc__": says, "__module__": __name__, "caught_by": caught_by, "blames": blames}
    # What is public they override on purpose: that is what is wrong with them.
    return type(base)(name, (base,), parts, overrides=[each for each in parts if hasattr(Robot, each)])


def edited(name: str, says: str, caught_by: str, blames: str, **parts: object) -> type[Broken]:
    """Return the reference adapter with some of its hooks replaced."""
    return _made(Broken, name, says, caught_by, blames, parts)


def sampled(
    name: str, says: str, caught_by: str, blames: str, edit: Callable[[Any, RobotState], RobotState]
) -> type[Broken]:
    """Return the reference adapter with its samples edited."""
    return edited(name, says, caught_by, blames, _sample=lambda self: edit(self, self._honest()))


def targeted(
    name: str, says: str, caught_by: str, blames: str, edit: Callable[[Any, Waypoint], Waypoint], **parts: object
) -> type[Broken]:
    """Return the reference adapter with the targets edited that it sends to the vehicle; goals are judged rightly."""

    def send(self: Any, goal: Goal) -> None:
        sent = Goal(self, goal.id, edit(self, goal.target), goal.by, goal.sent_s)
        self._mux.give(goal.by, sent, self._world.now_s)

    return edited(name, says, caught_by, blames, _send_goto=send, **parts)


def promising(base: type[Broken], name: str, says: str, caught_by: str, blames: str, **promise: object) -> type[Broken]:
    """Return an adapter that promises something else than it keeps."""
    declared = replace(base.declared, **promise)  # type: ignore[arg-type]
    return _made(base, name, says, caught_by, blames, {"declared": declared})


def wired(name: str, says: str, caught_by: str, blames: str, **parts: object) -> type[BrokenWire]:
    """Return the adapter behind a link with some of its hooks replaced."""
    return _made(BrokenWire, name, says, caught_by, blames, parts)


def driven(name: str, says: str, caught_by: str, blames: str, **parts: object) -> type[BrokenWire]:
    """Return the adapter behind a link with some of the vehicle's methods replaced."""
    vehicle = type(f"{name}Vehicle", (Vehicle,), parts)
    return _made(BrokenWire, name, says, caught_by, blames, {"vehicle_class": vehicle})
