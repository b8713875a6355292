"""The control flow inside one machine: runs a handler, and all that follows from its result."""

from __future__ import annotations

import contextlib
from collections import deque
from types import CoroutineType
from typing import TYPE_CHECKING, Any, Final

from soter.machine.errors import ForeignAwait, MachineError, SpecError, UnhandledEventError
from soter.machine.events import Event, Halt, MachineRef
from soter.machine.intake import EVENT, INTERRUPTED, NOTHING, RECEIVED, START, Intake, Wait
from soter.machine.states import NO_PAYLOAD, Goto, Raise, State, Stay
from soter.machine.tables import (
    CROSS,
    ENTER,
    FIRST_SILENT,
    IGNORE,
    LAST_INTERRUPTIBLE,
    PREEMPT,
    Action,
    ClassTable,
    Handler,
    StateTable,
)

if TYPE_CHECKING:
    from soter.machine.core import Core

_SUSPENDED: Final = object()
_LONGEST_CHAIN: Final = 100_000

Ending = tuple["StateTable | None", Any, "Handler | None", "Event | None"]


class MachineContext(Intake):
    """What the runtime keeps for one machine.

    The machine context runs handlers and follows their results; the runtime decides when, and owns everything between
    machines.
    """

    __slots__ = (
        "core",
        "coro",
        "ending",
        "entry_lost",
        "halted",
        "halting",
        "machine",
        "outbox",
        "ready",
        "table",
        "told",
    )

    def __init__(self, core: Core, ref: MachineRef, table: ClassTable, start: StateTable) -> None:
        super().__init__(ref, start)
        self.core = core
        self.table = table
        self.machine: Any = None
        # Under systematic testing: what its handlers have sent and created, to take effect in later steps; else None.
        self.outbox: deque[tuple[MachineRef | MachineContext | None, Event | None]] | None = None
        self.told = False  # specs have seen the first of the outbox
        self.coro: CoroutineType[Any, Any, Any] | None = None
        self.ending: Ending | None = None
        self.entry_lost = False  # an interrupt has abandoned the entry handler
        self.ready = False  # it is in the list of machines that can take a step, or taking one
        self.halting = False  # it will be halted when its outbox is empty
        self.halted = False

    # Running

    def perform(self) -> None:
        """Do the step that `take` has decided on.

        Raises:
            MachineError: The machine has failed.
        """
        kind = self.pending
        event = self.pending_event
        self.pending = NOTHING
        self.pending_event = None
        if kind == EVENT:
            state = self.state
            self.event = event
            action = state.actions.get(event.__class__) or state.action(event.__class__)
            if action.target is None and action.handler is not None:
                self._follow(self._call(action.handler, event))
            else:
                self._run(self._act(action, event))
        elif kind == RECEIVED:
            self._resume(event)
        elif kind == START:
            self.core.entered(self, None, self.state)
            self._run(self._entry(event))
        elif kind == INTERRUPTED:
            self._interrupt(event)
        else:
            assert self.state.idle is not None
            self.core.idling(self)
            self._run((self.state.idle, None))

    def _resume(self, event: Event) -> None:
        wait = self.waiting
        handler = self.handler
        assert wait is not None
        assert handler is not None
        self.event = event
        self.waiting = None
        if event.__class__ is Halt and not wait.explicit_halt:
            self.abandon()
            if handler.role < FIRST_SILENT:
                self._run(self._dispatch(event))
                return
            # The state is being left already, so nothing can handle the Halt any more. But an unhandled event, which
            # may be why the state is left, must not go unnoticed.
            assert self.ending is not None
            if self.ending[0] is None:
                self._run(self._proceed(crossed=True))
            else:
                self.handler = None
                self.core.halt(self)
            return
        self._follow(self._advance(event))

    def _interrupt(self, event: Event) -> None:
        lost = False
        if self.coro is not None:
            assert self.handler is not None
            lost = self.handler.role == ENTER
            self.waiting = None
            self.abandon()
        self.event = event
        self.entry_lost = lost
        self._run(self._act(self.state.action(event.__class__), event))

    def _run(self, following: tuple[Handler, Any] | None) -> None:
        if following is not None:
            self._follow(self._call(*following))

    def _follow(self, result: Any) -> None:
        for _ in range(_LONGEST_CHAIN):
            if result is _SUSPENDED:
                return
            following = self._next(result)
            if following is None:
                self.handler = None
                return
            result = self._call(*following)
        raise self.error(f"never comes to rest: {_LONGEST_CHAIN} transitions or raised events in one step")

    def _call(self, handler: Handler, argument: Any) -> Any:
        self.handler = handler
        try:
            if handler.takes and argument is not NO_PAYLOAD:
                result = handler.call(self.machine, argument)
            else:
                result = handler.call(self.machine)
        except KeyboardInterrupt:
            raise
        except BaseException as exc:
            raise self.failure(exc) from exc
        if result.__class__ is CoroutineType:
            self.coro = result
            return self._advance(None)
        return result

    def _advance(self, value: Event | None) -> Any:
        """Drive the handler to its next `receive` or to its end."""
        coro = self.coro
        assert coro is not None
        try:
            request = coro.send(value)
            while request.__class__ is not Wait or request.context is not self:
                what = "receive() of another machine" if isinstance(request, Wait) else type(request).__name__
                assert coro.cr_frame is not None
                # Raised where it was awaited, so that the traceback shows users' own lines.
                request = coro.throw(ForeignAwait(what, coro.cr_frame.f_lineno))
        except StopIteration as stop:
            self.coro = None
            return stop.value
        except KeyboardInterrupt:
            self.coro = None
            raise
        except BaseException as exc:
            # A handler that exits or cancels has failed as well; it must not end the program.
            self.coro = None
            raise self.failure(exc) from exc
        handler = self.handler
        if self.state.interrupts and handler is not None and handler.role <= LAST_INTERRUPTIBLE:
            for event in request.events[:-1]:
                if self.state.action(event).kind == PREEMPT:
                    error = self.error(
                        f"receives {event.__name__}, which this state takes as an interrupt: it can never come"
                    )
                    self.abandon(quietly=True)
                    raise error
        self.waiting = request
        return _SUSPENDED

    def abandon(self, *, quietly: bool = False) -> None:
        """Close the suspended handler. Its `finally` blocks run and may not await.

        Args:
            quietly: Swallow what goes wrong, since another failure is being reported.

        Raises:
            MachineError: The handler awaited or raised while it was being closed.
        """
        coro, self.coro, self.waiting = self.coro, None, None
        if coro is None:
            return
        try:
            coro.throw(GeneratorExit)
        except (GeneratorExit, StopIteration):
            return
        except KeyboardInterrupt:
            raise
        except BaseException as exc:
            if not quietly:
                raise self.failure(exc, "while being abandoned, raised ") from exc
            return
        with contextlib.suppress(RuntimeError):
            coro.close()
        if not quietly:
            raise self.error("awaits in a finally or except while it is being abandoned")

    # Following results

    def _next(self, result: Any) -> tuple[Handler, Any] | None:
        """Return the handler that a result leads to, with its argument; None if the machine comes to rest."""
        handler = self.handler
        assert handler is not None
        cls = result.__class__
        if result is None or cls is Stay:
            if handler.role >= FIRST_SILENT:
                return self._proceed(crossed=handler.role == CROSS)
            if result is None and not handler.may_end:
                raise self.error(
                    "returned None although it is declared to return something else: a path without a return?"
                )
            if self.entry_lost:
                raise self.error(
                    "must return Goto, Raise or Halt: the entry handler it has interrupted is never resumed"
                )
            return None
        if handler.role >= FIRST_SILENT:
            raise self.error(f"returned {result!r}, but while a state is left nothing can be decided")
        self.entry_lost = False
        if cls is Goto:
            target = self.table.by_state.get(result.state) if isinstance(result.state, State) else None
            if target is None:
                raise self.error(f"returned {result!r}, but that is no state of {self.table.name}")
            return self._leave((target, result.payload, None, self.event))
        if cls is Raise:
            if not isinstance(result.event, Event):
                raise self.error(f"returned {result!r}, but only events can be raised")
            return self._dispatch(result.event)
        if cls is Halt:
            return self._dispatch(result)
        raise self.error(f"returned {result!r}; a handler returns Stay, Goto, Raise or Halt")

    def _dispatch(self, event: Event) -> tuple[Handler, Any] | None:
        self.event = event
        return self._act(self.state.action(event.__class__), event)

    def _act(self, action: Action, event: Event) -> tuple[Handler, Any] | None:
        if action.target is not None:
            return self._leave((action.target, event, action.handler, event))
        if action.handler is not None:
            return action.handler, event
        if action.kind == IGNORE:
            self.handler = None
            return None
        # Unhandled; a raised event cannot be deferred either, since it is not in the queue.
        return self._leave((None, None, None, event))

    def _leave(self, ending: Ending) -> tuple[Handler, Any] | None:
        self.ending = ending
        self.entry_lost = False
        if self.state.exit is not None:
            return self.state.exit, None
        return self._proceed(crossed=False)

    def _proceed(self, *, crossed: bool) -> tuple[Handler, Any] | None:
        assert self.ending is not None
        target, payload, crossing, event = self.ending
        if crossing is not None and not crossed:
            return crossing, payload
        self.ending = None
        self.event = event  # the exit handler may have received others
        if target is None:
            self.handler = None
            if event.__class__ is Halt:
                self.core.halt(self)
                return None
            raise self.error(f"{type(event).__name__} is not handled", UnhandledEventError)
        old, self.state = self.state, target
        self.core.entered(self, old, target)
        return self._entry(payload)

    def _entry(self, payload: Any) -> tuple[Handler, Any] | None:
        entry = self.state.entry
        if entry is None:
            self.handler = None
            return None
        if payload is NO_PAYLOAD and entry.takes and not entry.optional:
            self.handler = entry
            raise self.error("takes a payload, but the transition gave none")
        return entry, payload


class SpecContext(MachineContext):
    """What the runtime keeps for one spec: it is told of events at once and keeps its temperature."""

    __slots__ = ("heat", "hot_since")

    def __init__(self, core: Core, ref: MachineRef, table: ClassTable, start: StateTable) -> None:
        super().__init__(core, ref, table, start)
        self.heat = 0
        self.hot_since: int | None = None

    def temperature(self, steps: int) -> int:
        """Return how many steps the spec has been hot since it was last cold."""
        return self.heat if self.hot_since is None else self.heat + steps - self.hot_since

    def enter(self, target: StateTable, steps: int) -> None:
        """Keep the temperature when a state is entered."""
        self.heat = 0 if target.state.cold else self.temperature(steps)
        self.hot_since = steps if target.state.hot else None

    def tell(self, event: Event) -> None:
        """Handle an event at once."""
        self.pending_event = event
        self.pending = EVENT
        self.perform()

    def error(self, reason: str, kind: type[MachineError] = SpecError) -> MachineError:
        """Describe a failure; whatever fails in a spec is a failure of the spec."""
        return super().error(reason, SpecError)
