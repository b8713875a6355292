"""The language of machines: states, decorators that attach handlers, and the results of handlers."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Final, Generic, TypeAlias, TypeVar, overload

from soter.machine.events import Event, Halt


class _Missing:
    """Stands for a payload that was not given, since None is a payload too."""

    def __repr__(self) -> str:
        return "no payload"


NO_PAYLOAD: Final = _Missing()


class Stay:
    """Remain in the state: nothing is exited, nothing is entered."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "Stay()"


class Goto:
    """Leave the state and enter another one, or the same one again.

    Args:
        state: A state of the machine's own class or of a base of it.
        payload: What the entry handler of that state is called with.
    """

    __slots__ = ("payload", "state")

    @overload
    def __init__(self, state: State[None]) -> None: ...
    @overload
    def __init__(self, state: State[T], payload: T) -> None: ...
    def __init__(self, state: State[Any], payload: Any = NO_PAYLOAD) -> None:
        self.state = state
        self.payload = payload

    def __repr__(self) -> str:
        payload = "" if self.payload is NO_PAYLOAD else f", {self.payload!r}"
        return f"Goto({getattr(self.state, 'name', self.state)}{payload})"


class Raise:
    """Handle an event in this machine at once, before anything is taken from the queue.

    Args:
        event: The event; specs do not see it, since nobody sent it.
    """

    __slots__ = ("event",)

    def __init__(self, event: Event) -> None:
        self.event = event

    def __repr__(self) -> str:
        return f"Raise({self.event!r})"


Next: TypeAlias = Stay | Goto | Raise | Halt
"""What a handler returns. One declared to return None, or not annotated, may just end: that is `Stay`."""

T = TypeVar("T")
P = TypeVar("P")
M = TypeVar("M")
R = TypeVar("R", bound="Next | Coroutine[Any, Any, Next | None] | None")
H = TypeVar("H")
E = TypeVar("E", bound=Event)
E1 = TypeVar("E1", bound=Event)
E2 = TypeVar("E2", bound=Event)
E3 = TypeVar("E3", bound=Event)

ENTRY: Final = "entry"
EXIT: Final = "exit"
IDLE: Final = "idle"
ON: Final = "on"
INTERRUPT: Final = "interrupt"


@dataclass(eq=False, slots=True)
class Registration:
    """One use of a decorator; it takes effect when the class in whose body it stands is complete."""

    state: State[Any]
    kind: str
    events: tuple[type[Event], ...]
    goto: State[Any] | str | None
    handler: Any = None

    def where(self, cls: type) -> str:
        """Return the handler's name for messages."""
        kind = self.kind
        if self.events:
            kind += "(" + ", ".join(getattr(event, "__name__", repr(event)) for event in self.events) + ")"
        name = f" ({self.handler.__name__})" if hasattr(self.handler, "__name__") else ""
        return f"{cls.__name__}.{self.state.name}.{kind}{name}"


class OnDecorator(Generic[E]):
    """What `State.on` and `State.interrupt` return; it attaches a method and leaves it as it is."""

    __slots__ = ("_registration",)

    def __init__(self, registration: Registration) -> None:
        self._registration = registration

    @overload
    def __call__(self, handler: Callable[[M, E], R]) -> Callable[[M, E], R]: ...
    @overload
    def __call__(self, handler: Callable[[M], R]) -> Callable[[M], R]: ...
    def __call__(self, handler: Any) -> Any:
        """Attach the handler."""
        return _attach(self._registration, handler)


class State(Generic[P]):
    """A state of a machine, declared in the class body: ``Waiting = State(start=True)``.

    ``State[X]`` says that the state's entry handler takes an ``X``; type checkers then check every `Goto` to
    it. A state without that annotation is not checked. The attribute's name is the state's name.

    Args:
        start: The machine begins here. Exactly one state of a class does.
        defer: Events that stay in the queue while the machine is in this state.
        ignore: Events that are dropped in this state.
        hot: For specs: something that has to happen has not happened yet.
        cold: For specs: nothing is owed. Entering a cold state resets the temperature.
    """

    def __init__(
        self: State[Any],
        *,
        start: bool = False,
        defer: tuple[type[Event], ...] = (),
        ignore: tuple[type[Event], ...] = (),
        hot: bool = False,
        cold: bool = False,
    ) -> None:
        self.start = start
        self.defer = tuple(defer)
        self.ignore = tuple(ignore)
        self.hot = hot
        self.cold = cold
        self.name = "?"
        self.owner: type | None = None
        self.names: list[tuple[type, str]] = []
        self.pending: list[Registration] = []

    def __set_name__(self, owner: type, name: str) -> None:
        # An error raised here would reach the user wrapped in a RuntimeError; the class checks its states
        # later.
        self.names.append((owner, name))
        if self.owner is None:
            self.owner, self.name = owner, name

    def __repr__(self) -> str:
        owner = "?" if self.owner is None else self.owner.__name__
        return f"<State {owner}.{self.name}>"

    @overload
    def entry(self, handler: Callable[[M, P], R]) -> Callable[[M, P], R]: ...
    @overload
    def entry(self, handler: Callable[[M], R]) -> Callable[[M], R]: ...
    def entry(self, handler: Any) -> Any:
        """Run a method when the state is entered, with the payload if the method takes one.

        The payload is the one of the `Goto`, the event of an ``on(..., goto=...)``, or, at the start, that of
        `create`.
        """
        return _attach(Registration(self, ENTRY, (), None), handler)

    def exit(self, handler: Callable[[M], R]) -> Callable[[M], R]:
        """Run a method when the state is left. It may receive; it may not return Goto, Raise or Halt."""
        attached: Callable[[M], R] = _attach(Registration(self, EXIT, (), None), handler)
        return attached

    def idle(self, handler: Callable[[M], R]) -> Callable[[M], R]:
        """Run a method whenever nothing can be dequeued in this state.

        Under systematic testing it can run again and again; a live runtime runs it once in a row in every
        `run`.
        """
        attached: Callable[[M], R] = _attach(Registration(self, IDLE, (), None), handler)
        return attached

    @overload
    def on(self, event: type[E1], /, *, goto: State[Any] | str | None = None) -> OnDecorator[E1]: ...
    @overload
    def on(
        self, event: type[E1], event2: type[E2], /, *, goto: State[Any] | str | None = None
    ) -> OnDecorator[E1 | E2]: ...
    @overload
    def on(
        self, event: type[E1], event2: type[E2], event3: type[E3], /, *, goto: State[Any] | str | None = None
    ) -> OnDecorator[E1 | E2 | E3]: ...
    @overload
    def on(self, *events: type[Event], goto: State[Any] | str | None = None) -> OnDecorator[Any]: ...
    def on(self, *events: type[Event], goto: State[Any] | str | None = None) -> OnDecorator[Any]:
        """Handle events in this state.

        Without `goto` the decorated method decides by what it returns. With `goto` the event leads to that
        state: the exit handler of this state runs, then the decorated method, if there is one, then the entry
        handler of the other state with the event. Such a method returns nothing. ``Waiting.on(Ping,
        goto=Busy)`` may stand alone.

        An event class stands for its subclasses too, unless the state says something about them as well. Only
        `Halt` is never meant by its base class, so that a catch-all ``on(Event)`` does not keep a machine alive.
        """
        return self._register(ON, events, goto)

    @overload
    def interrupt(self, event: type[E1], /, *, goto: State[Any] | str | None = None) -> OnDecorator[E1]: ...
    @overload
    def interrupt(
        self, event: type[E1], event2: type[E2], /, *, goto: State[Any] | str | None = None
    ) -> OnDecorator[E1 | E2]: ...
    @overload
    def interrupt(self, *events: type[Event], goto: State[Any] | str | None = None) -> OnDecorator[Any]: ...
    def interrupt(self, *events: type[Event], goto: State[Any] | str | None = None) -> OnDecorator[Any]:
        """Handle events in this state ahead of the queue, and even while a handler waits in `receive`.

        The waiting handler is abandoned: it is closed and never resumes, and its ``finally`` may not await.
        If it was the entry handler, the interrupt handler must return Goto, Raise or Halt. Exit handlers,
        handlers of transitions and other interrupt handlers are not interrupted.
        """
        return self._register(INTERRUPT, events, goto)

    def _register(self, kind: str, events: tuple[type[Event], ...], goto: State[Any] | str | None) -> OnDecorator[Any]:
        registration = Registration(self, kind, events, goto)
        if goto is not None:
            self.pending.append(registration)
        return OnDecorator(registration)


def _attach(registration: Registration, handler: H) -> H:
    """Register a handler. It is checked with its class, when all names are known."""
    if registration.handler is not None:
        # One decorator object applied twice: the second method must be reported as a duplicate, not forgotten.
        registration = Registration(registration.state, registration.kind, registration.events, registration.goto)
        registration.state.pending.append(registration)
    elif registration.goto is None:
        registration.state.pending.append(registration)
    registration.handler = handler
    if isinstance(handler, FunctionType):
        # By this mark a class finds handlers in its body whose state belongs to another class.
        handler.__dict__.setdefault("soter_states", []).append(registration.state)
    return handler
