"""The base classes of machines and specs, with what their handlers may call."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, TypeVar, overload

from soter.machine.context import MachineContext
from soter.machine.errors import MachineDefinitionError, MisuseError
from soter.machine.events import Event, MachineRef, is_event_class
from soter.machine.intake import Wait
from soter.machine.states import NO_PAYLOAD
from soter.machine.tables import ClassTable, compile_class

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.machine.intake import Timer

E1 = TypeVar("E1", bound=Event)
E2 = TypeVar("E2", bound=Event)
E3 = TypeVar("E3", bound=Event)
V = TypeVar("V")


class Machine:
    """Base of all machines.

    The class body declares the states and attaches handlers to them; the constructor, if there is one, takes
    what `create` passes as keywords. A handler is a method with at most one argument besides `self`, plain or
    ``async``. It returns `Stay`, `Goto`, `Raise` or `Halt`. The methods below are for its use: they may be
    called only while a handler of this very machine runs, and never by another thread.

    A subclass inherits states and handlers. It may add states, add handlers to inherited states
    (``@Base.Waiting.on(...)``), and override a handler by a method of the same name or by a handler for the
    same event. ``class Base(Machine, abstract=True)`` lacks a start state and cannot be created.
    """

    _context: MachineContext
    __table__: ClassVar[ClassTable] = ClassTable("Machine", None, {}, {})

    def __init_subclass__(cls, *, abstract: bool = False, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.__table__ = compile_class(cls, _MACHINE_NAMES, abstract=abstract, spec=False)

    @property
    def ref(self) -> MachineRef:
        """This machine's reference, to send to others."""
        return self._own_context().ref

    def now(self) -> float:
        """Return the time in seconds on the runtime's clock."""
        return self._own_context().core.now()

    def send(self, to: MachineRef, event: Event) -> None:
        """Send an event to a machine. It is dropped if that machine is halted.

        Raises:
            EventError: The event is not immutable.
            MisuseError: There is no such machine, or no handler of this machine is running.
        """
        try:
            context = self._context
        except AttributeError:
            context = self._own_context()
        core = context.core
        if core.current is not context:
            self._running_context("send")
        core.send(context, to, event)

    def announce(self, event: Event) -> None:
        """Show an event to the specs only.

        Raises:
            EventError: The event is not immutable.
            MisuseError: No handler of this machine is running.
        """
        context = self._running_context("announce")
        context.core.announce(context, event)

    def create(
        self, machine: type[Machine], payload: object = NO_PAYLOAD, *, name: str | None = None, **kwargs: Any
    ) -> MachineRef:
        """Create a machine; it starts in a later step. See `Runtime.create`."""
        context = self._running_context("create")
        return context.core.create_from(context, machine, payload, name, kwargs)

    def after(self, delay_s: float, event: Event) -> Timer:
        """Send an event to this machine after a delay.

        Args:
            delay_s: Seconds on the runtime's clock, 0 or more.
            event: The event.

        Raises:
            ValueError: The delay is negative or not finite.
        """
        context = self._running_context("after")
        if not (math.isfinite(delay_s) and delay_s >= 0.0):
            raise ValueError(f"a delay must be a finite number of seconds, 0 or more, not {delay_s!r}")
        return context.core.call_at(context.core.now() + delay_s, context.ref, event)

    @overload
    def choose(self, options: int) -> int: ...
    @overload
    def choose(self, options: Sequence[V]) -> V: ...
    def choose(self, options: int | Sequence[V]) -> int | V:
        """Make a choice that a systematic tester explores; a live runtime takes the first.

        Args:
            options: A number n for a choice from 0 to n - 1, or a sequence to choose an element of.

        Raises:
            ValueError: There is nothing to choose from.
        """
        context = self._running_context("choose")
        if isinstance(options, int):
            return context.core.choose(options)
        return options[context.core.choose(len(options))]

    @overload
    async def receive(self, event: type[E1], /, *, match: Callable[[E1], bool] | None = None) -> E1: ...
    @overload
    async def receive(
        self, event: type[E1], event2: type[E2], /, *, match: Callable[[E1 | E2], bool] | None = None
    ) -> E1 | E2: ...
    @overload
    async def receive(
        self,
        event: type[E1],
        event2: type[E2],
        event3: type[E3],
        /,
        *,
        match: Callable[[E1 | E2 | E3], bool] | None = None,
    ) -> E1 | E2 | E3: ...
    @overload
    async def receive(self, *events: type[Event], match: Callable[[Any], bool] | None = None) -> Event: ...
    async def receive(self, *events: type[Event], match: Callable[[Any], bool] | None = None) -> Event:
        """Wait for one of some events: ``ended = await self.receive(GoalEnded, match=lambda g: g.id == 7)``.

        All other events stay in the queue, whatever the state says about them. A `Halt` that is not listed is
        received too: the handler is then abandoned and the halt is raised in the state.

        Args:
            events: The event classes to wait for; each stands for its subclasses too.
            match: Tells whether an event of these classes is the awaited one. It must depend on nothing that
                changes.

        Raises:
            MisuseError: No event class is given, or no handler of this machine is running.
        """
        context = self._running_context("receive")
        if not events or not all(is_event_class(event) for event in events):
            raise MisuseError(f"receive() takes event classes, not {events!r}")
        return await Wait(context, events, match)

    def _own_context(self) -> MachineContext:
        try:
            return self._context
        except AttributeError:
            raise MisuseError(
                f"this {type(self).__name__} belongs to no runtime: make it with create(), not by a call"
            ) from None

    def _running_context(self, what: str) -> MachineContext:
        context = self._own_context()
        if context.core.current is not context:
            raise MisuseError(
                f"{what}() of {context.ref} was called while none of its handlers runs; "
                f"other code and other threads use runtime.post()"
            )
        return context


_MACHINE_NAMES = frozenset({"_context", *(name for name in vars(Machine) if not name.startswith("__"))})


class Spec:
    """Base of all specs: machines that watch the events others send, and judge.

    ``class Progress(Spec, observes=(Ping, Pong))`` is told of every such event at the moment it is sent. A
    spec reports a violation by raising any exception, so ``assert`` will do. If it is in a hot state when a
    run is finished, something that had to happen has not. It only watches: it may not send, create, receive,
    defer or choose, and its handlers are plain functions.

    ``observes`` names the event classes it is told of, each with its subclasses, but `Halt` only if it is named itself;
    by default those of the base class. A class with ``abstract=True`` lacks a start state and cannot be used itself.
    """

    __table__: ClassVar[ClassTable] = ClassTable("Spec", None, {}, {})
    __observes__: ClassVar[tuple[type[Event], ...]] = ()

    def __init_subclass__(
        cls, *, observes: Sequence[type[Event]] | None = None, abstract: bool = False, **kwargs: Any
    ) -> None:
        super().__init_subclass__(**kwargs)
        if observes is not None:
            cls.__observes__ = tuple(observes)
        for event in cls.__observes__:
            if not is_event_class(event):
                raise MachineDefinitionError(f"{cls.__name__}: observes={event!r} is not an event class")
        cls.__table__ = compile_class(cls, (), abstract=abstract, spec=True)
        if cls.__table__.start is not None and not cls.__observes__:
            raise MachineDefinitionError(
                f"{cls.__name__} observes nothing: class {cls.__name__}(Spec, observes=(SomeEvent,))"
            )
        for state in cls.__table__.states.values():
            for event in state.declared:
                if not issubclass(event, cls.__observes__):
                    raise MachineDefinitionError(
                        f"{cls.__name__}.{state.name}: {event.__name__} is not in observes; add it there"
                    )

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NoReturn:
            """Raise an error that says why a spec lacks a method of machines."""
            if name in _MACHINE_NAMES:
                raise MisuseError(f"{type(self).__name__} is a spec and only watches: it has no {name}()")
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
