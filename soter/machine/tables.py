"""Compiles a machine class into lookup tables when it is defined, and reports its errors."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn

from soter.errors import nearest
from soter.machine.errors import MachineDefinitionError
from soter.machine.events import Halt, is_event_class
from soter.machine.states import ENTRY, EXIT, IDLE, INTERRUPT, Registration, State

# What a handler is for. Up to LAST_INTERRUPTIBLE an interrupt may abandon it; from FIRST_SILENT on it may not
# decide where to go.
ACT, ENTER, REST, INTERRUPTING, LEAVE, CROSS = range(6)
LAST_INTERRUPTIBLE: Final = REST
FIRST_SILENT: Final = LEAVE

# What a state does with an event. Up to LAST_TAKEN the event is taken from the queue.
HANDLE, SWITCH, PREEMPT, UNHANDLED, IGNORE, DEFER = range(6)
LAST_TAKEN: Final = UNHANDLED


@dataclass(frozen=True, slots=True)
class Handler:
    """A handler method, and what the control flow needs to know about it.

    Attributes:
        call: The method as a plain function.
        takes: Whether it is called with a payload or an event besides the machine.
        optional: Whether that parameter has a default.
        role: One of the roles above.
        may_end: Whether it may end without a result: declared to return None, or not annotated.
        where: Its name for messages.
    """

    call: Callable[..., Any]
    takes: bool
    optional: bool
    role: int
    may_end: bool
    where: str


@dataclass(frozen=True, slots=True)
class Action:
    """What a state does with one class of events."""

    kind: int
    handler: Handler | None = None
    target: StateTable | None = None


_UNHANDLED: Final = Action(UNHANDLED)


@dataclass(eq=False, slots=True)
class StateTable:
    """A state, compiled for one class."""

    name: str
    state: State[Any]
    entry: Handler | None = None
    exit: Handler | None = None
    idle: Handler | None = None
    declared: dict[type, Action] = field(default_factory=dict)
    actions: dict[type, Action] = field(default_factory=dict)
    interrupts: bool = False

    def action(self, cls: type) -> Action:
        """Return the action for an event class, found by the nearest of its bases; cached."""
        action = self.actions.get(cls)
        if action is None:
            # Halt only counts if it is named: a catch-all must not keep a machine alive.
            meant = (cls,) if cls is Halt else cls.__mro__
            bases = (self.declared.get(base) for base in meant)
            action = next((found for found in bases if found is not None), _UNHANDLED)
            self.actions[cls] = action
        return action


@dataclass(eq=False, slots=True)
class ClassTable:
    """A machine class, compiled. `start` is None for a class that cannot be created."""

    name: str
    start: StateTable | None
    states: dict[str, StateTable]
    by_state: dict[State[Any], StateTable]


def compile_class(cls: type, reserved: Iterable[str], *, abstract: bool, spec: bool) -> ClassTable:
    """Check a class and compile it.

    Args:
        cls: A subclass of Machine or Spec whose class statement is just being completed.
        reserved: Names of the base class that a machine may not use for something else.
        abstract: The class has no start state; its subclasses will.
        spec: The class is a spec, to which stricter rules apply.

    Raises:
        MachineDefinitionError: The class is wrong; the message names the class, the state and the handler.
    """
    for name in sorted(set(reserved) & set(vars(cls))):
        _refuse(f"{cls.__name__}.{name}: the name belongs to the base class; choose another one")
    states = _states_of(cls)
    cls.__registrations__ = _own_registrations(cls, states)  # type: ignore[attr-defined]
    tables = {name: StateTable(name, state) for name, state in states.items()}
    by_state = {table.state: table for table in tables.values()}
    compiler = _Compiler(cls, tables, by_state, spec)
    for table in tables.values():
        compiler.declare(table)
    for base in reversed(cls.__mro__):
        for registration in vars(base).get("__registrations__", ()):
            compiler.register(base, registration)
    for table in tables.values():
        table.actions = dict(table.declared)
        table.interrupts = any(action.kind == PREEMPT for action in table.declared.values())
    starts = [table for table in tables.values() if table.state.start]
    if len(starts) > 1:
        names = " and ".join(table.name for table in starts)
        _refuse(f"{cls.__name__} has more than one start state: {names}; keep start=True on one of them")
    if tables and not starts and not abstract:
        _refuse(
            f"{cls.__name__} has no start state: declare one with State(start=True), or the class with abstract=True"
        )
    start = starts[0] if starts and not abstract else None
    return ClassTable(cls.__name__, start, tables, by_state)


def _refuse(message: str) -> NoReturn:
    raise MachineDefinitionError(message)


def _states_of(cls: type) -> dict[str, State[Any]]:
    states: dict[str, State[Any]] = {}
    for base in reversed(cls.__mro__):
        for name, value in vars(base).items():
            if name in states and value is not states[name]:
                owner = states[name].owner
                _refuse(
                    f"{cls.__name__}.{name}: this is already a state of {owner.__name__ if owner else '?'}; "
                    f"a subclass keeps inherited states and adds handlers with @{name}.on(...)"
                )
            if isinstance(value, State):
                if len(value.names) > 1:
                    places = " and ".join(f"{owner.__name__}.{other}" for owner, other in value.names)
                    _refuse(f"{places} are the same State object; give each its own State()")
                states[name] = value
    return states


def _own_registrations(cls: type, states: Mapping[str, State[Any]]) -> list[Registration]:
    """Return the registrations that decorators in the body of this class left in its own and inherited states."""
    own = []
    for state in states.values():
        own += state.pending
        # Clear them even if the class turns out to be wrong: the next class must not get them.
        state.pending = []
    for name, value in vars(cls).items():
        for state in getattr(value, "soter_states", ()):
            if all(state is not mine for mine in states.values()):
                state.pending = [left for left in state.pending if left.handler is not value]
                _refuse(f"{cls.__name__}.{name} handles {state!r}, which is no state of {cls.__name__}")
    for registration in own:
        handler = registration.handler
        if handler is None:
            continue
        where = registration.where(cls)
        if not isinstance(handler, types.FunctionType):
            _refuse(f"{where}: a handler is a method, not a {type(handler).__name__}")
        if vars(cls).get(handler.__name__) is not handler:
            _refuse(
                f"{where}: {handler.__name__} is not this method when the class is complete; give every handler "
                f"its own name and put the state's decorator outermost"
            )
    return own


class _Compiler:
    """Fills the state tables of one class."""

    def __init__(
        self,
        cls: type,
        tables: dict[str, StateTable],
        by_state: dict[State[Any], StateTable],
        spec: bool,
    ) -> None:
        self.cls = cls
        self.tables = tables
        self.by_state = by_state
        self.spec = spec
        self.owners: dict[tuple[str, str | type], type] = {}

    def declare(self, table: StateTable) -> None:
        """Enter the options of a State into its table."""
        state = table.state
        where = f"{self.cls.__name__}.{table.name}"
        if self.spec and state.defer:
            _refuse(f"{where}: a spec sees events when they are sent and cannot defer them")
        if not self.spec and (state.hot or state.cold):
            _refuse(f"{where}: only states of specs are hot or cold")
        if state.hot and state.cold:
            _refuse(f"{where}: a state cannot be both hot and cold")
        for kind, word, events in ((DEFER, "defer", state.defer), (IGNORE, "ignore", state.ignore)):
            for event in events:
                self._event(event, f"{where}.{word}")
                if event in table.declared:
                    _refuse(f"{where}: {event.__name__} is deferred or ignored more than once")
                table.declared[event] = Action(kind)
                self.owners[table.name, event] = state.owner or self.cls

    def register(self, base: type, registration: Registration) -> None:
        """Enter one use of a decorator, in the body of the class or of a base."""
        table = self.by_state[registration.state]
        where = registration.where(base)
        if not registration.events:
            if registration.kind not in (ENTRY, EXIT, IDLE):
                _refuse(f"{where}: name at least one event class")
            self._claim(base, table, registration.kind, where)
            role = {ENTRY: ENTER, EXIT: LEAVE, IDLE: REST}[registration.kind]
            if role == REST and self.spec:
                _refuse(f"{where}: a spec runs only when an event is sent and has no idle handler")
            setattr(table, registration.kind, self._handler(registration, role, where))
            return
        interrupt = registration.kind == INTERRUPT
        if interrupt and self.spec:
            _refuse(f"{where}: a spec has nothing to interrupt; use on(...)")
        target = self._target(registration, where)
        handler = None
        if registration.handler is not None:
            role = CROSS if target is not None else INTERRUPTING if interrupt else ACT
            handler = self._handler(registration, role, where)
        kind = PREEMPT if interrupt else HANDLE if target is None else SWITCH
        for event in registration.events:
            self._event(event, where)
            self._claim(base, table, event, where)
            table.declared[event] = Action(kind, handler, target)

    def _claim(self, base: type, table: StateTable, key: str | type, where: str) -> None:
        """Let a subclass override its bases, but refuse two actions of one class for the same event."""
        if self.owners.get((table.name, key)) is base:
            what = key if isinstance(key, str) else key.__name__
            _refuse(f"{where}: state {base.__name__}.{table.name} already says what to do with {what}")
        self.owners[table.name, key] = base

    def _event(self, event: Any, where: str) -> None:
        if not is_event_class(event):
            _refuse(f"{where}: {getattr(event, '__name__', repr(event))} is not an event class")

    def _target(self, registration: Registration, where: str) -> StateTable | None:
        goto: Any = registration.goto
        if goto is None:
            return None
        if isinstance(goto, State):
            target = self.by_state.get(goto)
            if target is None:
                _refuse(f"{where}: goto={goto!r} is no state of {self.cls.__name__}")
            return target
        target = self.tables.get(goto) if isinstance(goto, str) else None
        if target is None:
            hint = nearest(goto, list(self.tables)) if isinstance(goto, str) else ""
            _refuse(f"{where}: goto={goto!r} is no state of {self.cls.__name__}{hint}")
        return target

    def _handler(self, registration: Registration, role: int, where: str) -> Handler:
        # By name, so that a subclass overrides a handler like any other method.
        call = getattr(self.cls, registration.handler.__name__, None)
        if not isinstance(call, types.FunctionType):
            _refuse(f"{where}: {self.cls.__name__} has replaced this method by something that is none")
        if inspect.isgeneratorfunction(call) or inspect.isasyncgenfunction(call):
            _refuse(f"{where}: a handler is a function or an async function and cannot yield")
        if self.spec and inspect.iscoroutinefunction(call):
            _refuse(f"{where}: a spec cannot wait; make this a plain function")
        signature = inspect.signature(call)
        parameters = list(signature.parameters.values())[1:]
        most = 0 if role in (LEAVE, REST) else 1
        positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
        others = [p for p in parameters if p.kind == p.KEYWORD_ONLY and p.default is p.empty]
        required = [p for p in positional if p.default is p.empty]
        if not signature.parameters or len(required) > most or others:
            what = "self" + ("" if most == 0 else " and at most one payload or event")
            _refuse(f"{where}: this handler is called with {what}, but it is declared as {signature}")
        takes = most == 1 and bool(positional)
        return Handler(call, takes, not required, role, _may_end(signature.return_annotation), where)


def _may_end(annotation: object) -> bool:
    """Tell whether a function with this return annotation may end without a return."""
    if annotation is inspect.Signature.empty or annotation is None:
        return True
    if isinstance(annotation, str):
        return "None" in annotation or "Optional" in annotation
    return type(None) in getattr(annotation, "__args__", ())
