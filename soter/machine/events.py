"""Events: the frozen dataclasses that machines send each other, and the references they send them to."""

from __future__ import annotations

import collections
import collections.abc
import dataclasses
import enum
import inspect
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

from soter.machine.errors import EventError


@dataclass(frozen=True)
class Event:
    """Base of all events.

    A subclass is a frozen dataclass whose fields are immutable: ``@dataclass(frozen=True, slots=True)``. An
    event without fields needs no decorator. The fields are checked when the class is first used, and a value
    that its annotation leaves open is checked at every send, so a mutable field is an `EventError` and not a
    data race. A frozenset is refused as well: its order differs between processes, and replays with it.
    """

    __slots__ = ()


@final
@dataclass(frozen=True, slots=True)
class Halt(Event):
    """Stops a machine.

    Returned by a handler it is raised in that machine; sent, it is an event like any other.

    A state may handle it; where it is not handled, the state's exit handler runs and the machine stops
    quietly. It is received by every ``receive``, listed or not.
    """


@dataclass(frozen=True, slots=True)
class MachineRef:
    """Names a machine, without giving access to it. It can be compared, hashed, put into events and pickled.

    Attributes:
        id: Number of the machine, unique in its runtime.
        name: Name for messages and recordings; it takes no part in comparisons.
        node: Name of the runtime that the machine lives in.
    """

    id: int
    name: str = dataclasses.field(compare=False)
    node: str = "local"

    def __str__(self) -> str:
        """Return the name."""
        return self.name


# How much of a field has to be looked at when an event is sent.
_TRUSTED, _SHALLOW, _DEEP = range(3)

_ATOMS: frozenset[type] = frozenset(
    {int, float, complex, bool, str, bytes, type(None), MachineRef, type, types.FunctionType}
)
_MUTABLE: tuple[type, ...] = (
    list,
    dict,
    set,
    bytearray,
    memoryview,
    collections.deque,
    types.MappingProxyType,
    types.SimpleNamespace,
)
_ABSTRACT_MUTABLE: frozenset[type] = frozenset(
    {collections.abc.MutableSequence, collections.abc.MutableMapping, collections.abc.MutableSet}
)

Guard = typing.Optional["Callable[[Event], None]"]
"""The check that instances of an event class must pass when they are sent; None if they need none."""

_guards: dict[type, Guard] = {}


def is_event_class(cls: object) -> bool:
    """Tell whether something is a class of events."""
    return isinstance(cls, type) and issubclass(cls, Event)


def check_event(event: Any) -> None:
    """Check an event that is about to be sent.

    Raises:
        EventError: It is no event, or one of its fields is mutable.
    """
    cls = event.__class__
    try:
        guard = _guards[cls]
    except KeyError:
        guard = _guards[cls] = _make_guard(cls)
    if guard is not None:
        guard(event)


def _make_guard(cls: Any) -> Guard:
    if not is_event_class(cls):
        name = getattr(cls, "__name__", repr(cls))
        raise EventError(f"{name} is not an event: derive it from soter.machine.Event")
    _check_declared(cls)
    levels = _field_levels(cls, {cls})
    shallow = tuple(name for name, level in levels.items() if level == _SHALLOW)
    deep = tuple(name for name, level in levels.items() if level == _DEEP)
    if not shallow and not deep:
        return None

    def guard(event: Event) -> None:
        for name in shallow:
            value = getattr(event, name)
            if isinstance(value, _MUTABLE):
                raise _mutable_value(cls, name, value)
        for name in deep:
            _check_value(cls, name, getattr(event, name))

    return guard


def _check_declared(cls: type) -> None:
    for base in cls.__mro__:
        own = inspect.get_annotations(base)
        if own and dataclasses.is_dataclass(base) and "__dataclass_fields__" not in base.__dict__:
            raise EventError(
                f"{base.__name__} has fields but is no dataclass: decorate it with @dataclass(frozen=True, slots=True)"
            )


def _field_levels(cls: type, seen: set[type]) -> dict[str, int]:
    """Classify the fields of a frozen dataclass by their annotations."""
    fields = dataclasses.fields(cls)
    try:
        hints: dict[str, Any] = typing.get_type_hints(cls)
    except (NameError, AttributeError, TypeError, SyntaxError):
        # Names imported for type checking only cannot be resolved here: look at the values instead.
        hints = {}
    levels = {}
    for field in fields:
        level, problem = _level(hints.get(field.name, Any), seen)
        if problem:
            raise EventError(f"field {field.name!r} of {cls.__name__} is mutable: {problem}")
        levels[field.name] = level
    return levels


def _level(hint: object, seen: set[type]) -> tuple[int, str]:
    """Return how closely values of a type must be looked at, and what makes the type unfit, if it is."""
    if isinstance(hint, typing.NewType):
        return _level(hint.__supertype__, seen)
    origin = typing.get_origin(hint)
    if origin is typing.Literal or origin is collections.abc.Callable or origin is type:
        return _TRUSTED, ""
    if origin is typing.Union or origin is types.UnionType or origin is tuple:
        level = _SHALLOW if origin is tuple else _TRUSTED
        for arg in typing.get_args(hint):
            if arg is not Ellipsis:
                inner, problem = _level(arg, seen)
                if problem:
                    return inner, problem
                level = max(level, inner)
        return level, ""
    cls = origin if origin is not None else hint
    if not isinstance(cls, type) or cls is object:
        return _DEEP, ""
    problem = _unfit(cls)
    if problem:
        return _DEEP, problem
    if cls in _ATOMS or issubclass(cls, enum.Enum) or cls in seen:
        return _TRUSTED, ""
    if dataclasses.is_dataclass(cls):
        inner_levels = _field_levels(cls, seen | {cls})
        return max(inner_levels.values(), default=_TRUSTED), ""
    return _DEEP, ""


def _unfit(cls: type) -> str:
    """Say why instances of a class cannot be part of an event; empty if they can."""
    if issubclass(cls, frozenset):
        return "a frozenset has another order in every process, so replays would differ; use a tuple"
    if issubclass(cls, _MUTABLE) or cls in _ABSTRACT_MUTABLE:
        return f"{cls.__name__} can be changed after it was sent; use a tuple or a frozen dataclass"
    if cls.__name__ == "ndarray" and cls.__module__ == "numpy":
        return "a numpy array can be changed after it was sent; use a tuple of floats"
    if dataclasses.is_dataclass(cls) and not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        return f"{cls.__name__} is a dataclass that is not frozen; declare it with @dataclass(frozen=True)"
    return ""


def _check_value(cls: type, name: str, value: object) -> None:
    kind = type(value)
    if kind in _ATOMS:
        return
    if _unfit(kind):
        raise _mutable_value(cls, name, value)
    if isinstance(value, tuple):
        for item in value:
            _check_value(cls, name, item)
    elif dataclasses.is_dataclass(kind):
        for field in dataclasses.fields(kind):
            _check_value(cls, name, getattr(value, field.name))


def _mutable_value(cls: type, name: str, value: object) -> EventError:
    return EventError(f"field {name!r} of {cls.__name__} holds a mutable {type(value).__name__}: {_unfit(type(value))}")
