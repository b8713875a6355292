"""What can go wrong with machines: exceptions that name the machine, the state, the handler and the event."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Self

from soter.errors import SoterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.machine.events import Event

_LONGEST_EVENT = 200


class MachineDefinitionError(SoterError):
    """A machine class is wrong as it is written; raised while the class statement runs."""


class EventError(SoterError, TypeError):
    """An event is not a frozen dataclass of immutable fields, so it cannot be shared between machines."""


class MisuseError(SoterError):
    """The runtime or a machine was called in a way it does not allow, such as a send outside a handler."""


class ForeignAwait(MisuseError):
    """A handler awaited something else than ``self.receive()``; raised in it, where it did.

    Attributes:
        what: The class of what was awaited, or whose ``receive()`` it was.
    """

    def __init__(self, what: str, line: int) -> None:
        """Name what was awaited, and the handler's line."""
        self.what = what
        super().__init__(f"awaited something else than self.receive(): {what}, in line {line}")


class MachineError(SoterError):
    """A machine failed while it ran. The machine is halted; the others can carry on.

    Attributes:
        machine: Name of the machine that failed.
        state: Name of the state it was in.
        handler: The handler that ran, as ``Class.State.kind (method)``; None if there was none.
        event: The event that was being handled; None at the start.
        reason: What happened, without the place.
    """

    def __init__(self, reason: str, *, machine: str, state: str, handler: str | None, event: Event | None) -> None:
        """Keep the place apart from the reason, and put both into the message."""
        self.reason = reason
        self.machine = machine
        self.state = state
        self.handler = handler
        self.event = event
        place = [f"machine {machine}", f"state {state}"]
        if handler is not None:
            place.append(f"handler {handler}")
        if event is not None:
            text = repr(event)
            place.append(f"event {text if len(text) <= _LONGEST_EVENT else text[:_LONGEST_EVENT] + '...'}")
        super().__init__(f"{reason} [{', '.join(place)}]")

    def __reduce__(self) -> tuple[partial[Self], tuple[()]]:
        """Pickle by the keyword arguments, so that a failure can be reported by another process."""
        again = partial(
            type(self), self.reason, machine=self.machine, state=self.state, handler=self.handler, event=self.event
        )
        return again, ()


class HandlerError(MachineError):
    """A handler raised an exception (then ``__cause__`` has it) or broke a rule of the machines."""


class UnhandledEventError(MachineError):
    """An event came to a state that neither handles, defers nor ignores it."""


class SpecError(MachineError):
    """A spec failed: what it watches has done what it forbids, or the spec itself is wrong."""


class LivenessError(SoterError):
    """Something that had to happen did not: a spec is, or stayed for too long, in a hot state.

    Attributes:
        specs: Names of the specs and of their hot states.
    """

    def __init__(self, reason: str, specs: Sequence[tuple[str, str]]) -> None:
        """Name every spec with its hot state."""
        self.reason = reason
        self.specs = tuple(specs)
        super().__init__(f"{reason}: " + ", ".join(f"{name} in hot state {state}" for name, state in specs))

    def __reduce__(self) -> tuple[type[LivenessError], tuple[Any, ...]]:
        """Pickle by the arguments."""
        return type(self), (self.reason, self.specs)
