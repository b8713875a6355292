from __future__ import annotations

import enum
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, NewType

import numpy as np
import pytest

from soter.machine import Event, EventError, HandlerError, MachineRef, State
from tests.machine.helpers import Logger, runtime, start

if TYPE_CHECKING:
    from decimal import Decimal

Metres = NewType("Metres", float)


class Colour(enum.Enum):
    RED = 1


class Pair(NamedTuple):
    x: object
    y: object


@dataclass(frozen=True)
class Point:
    x: float
    y: float


@dataclass(frozen=True)
class Box:
    content: object


@dataclass
class Mutable:
    x: float


class Plain:
    """An ordinary class, of which nothing is known."""


@dataclass(frozen=True, slots=True)
class Everything(Event):
    a: int
    b: float | None
    c: str
    d: tuple[Point, ...]
    e: MachineRef
    f: Colour
    g: Literal["x", "y"]
    h: Annotated[Metres, "m"]
    i: Callable[[], None]
    j: type[Event]
    k: Sequence[int]
    m: Mapping[str, int] | None
    n: Any
    o: Pair
    p: Box
    q: Plain


@dataclass(frozen=True)
class Unresolved(Event):
    value: Decimal | list[int]


@dataclass(frozen=True)
class Tupled(Event):
    path: tuple[int, ...]


@dataclass(frozen=True)
class WithList(Event):
    path: list[int]


@dataclass(frozen=True)
class WithOptionalDict(Event):
    table: tuple[dict[str, int] | None, ...]


@dataclass(frozen=True)
class WithFrozenset(Event):
    tags: frozenset[str]


@dataclass(frozen=True)
class WithMutable(Event):
    x: Mutable


@dataclass(frozen=True)
class Nested(Event):
    outer: WithList


@dataclass(frozen=True)
class WithArray(Event):
    x: np.ndarray[Any, Any]


class Undecorated(Event):
    x: int


@dataclass(frozen=True)
class Tree(Event):
    children: tuple[Tree, ...]


class Sink(Logger):
    S = State(start=True)

    @S.on(Event)
    def _any(self, e: Event) -> None:
        self.log.append(e)


def _everything(**changes: Any) -> Everything:
    values: dict[str, Any] = {
        "a": 1,
        "b": None,
        "c": "",
        "d": (Point(0.0, 1.0),),
        "e": MachineRef(1, "x"),
        "f": Colour.RED,
        "g": "x",
        "h": Metres(1.0),
        "i": print,
        "j": Event,
        "k": (1, 2),
        "m": None,
        "n": ("a", (1, None, Point(0.0, 0.0))),
        "o": Pair(1, (2,)),
        "p": Box("x"),
        "q": Plain(),
    }
    return Everything(**values | changes)


def test_events_of_immutable_fields_are_sent() -> None:
    log: list[object] = []
    made, ref = start(Sink, log=log)
    events = [_everything(), Tree((Tree(()),)), Unresolved((1,)), Tupled((1,))]  # type: ignore[arg-type]
    for event in events:
        made.post(ref, event)
    made.run()
    assert log == events


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (WithList([1]), "field 'path' of WithList is mutable: list can be changed after it was sent; use a tuple"),
        (WithOptionalDict(()), "field 'table' of WithOptionalDict is mutable: dict can be changed"),
        (WithFrozenset(frozenset()), "a frozenset has another order in every process, so replays would differ"),
        (WithMutable(Mutable(1.0)), "field 'x' of WithMutable is mutable: Mutable is a dataclass that is not frozen"),
        (Nested(WithList([])), "field 'path' of WithList is mutable"),
        (WithArray(np.zeros(1)), "a numpy array can be changed after it was sent; use a tuple of floats"),
        (Undecorated(), "Undecorated has fields but is no dataclass: decorate it with @dataclass(frozen=True"),
        (Mutable(1.0), "Mutable is not an event: derive it from soter.machine.Event"),
        (Unresolved([1]), "field 'value' of Unresolved holds a mutable list"),
        (Tupled([1]), "field 'path' of Tupled holds a mutable list: list can be changed"),  # type: ignore[arg-type]
        (_everything(d=[]), "field 'd' of Everything holds a mutable list"),
        (_everything(k=[1]), "field 'k' of Everything holds a mutable list"),
        (_everything(m={}), "field 'm' of Everything holds a mutable dict"),
        (_everything(n=(1, (2, [3]))), "field 'n' of Everything holds a mutable list"),
        (_everything(n=Box(Mutable(1.0))), "field 'n' of Everything holds a mutable Mutable"),
        (_everything(n={1}), "field 'n' of Everything holds a mutable set"),
        (_everything(n=frozenset({1})), "field 'n' of Everything holds a mutable frozenset: a frozenset has"),
        (_everything(o=Pair([], 0)), "field 'o' of Everything holds a mutable list"),
        (_everything(p=Box([])), "field 'p' of Everything holds a mutable list"),
        (_everything(n=np.zeros(3)), "field 'n' of Everything holds a mutable ndarray"),
    ],
)
def test_others_are_refused_at_once(event: Any, message: str) -> None:
    made, ref = start(Sink)
    with pytest.raises(EventError) as caught:
        made.post(ref, event)
    assert message in str(caught.value)
    with pytest.raises(EventError):
        made.call_at(1.0, ref, event)


def test_a_frozen_event_cannot_have_a_subclass_that_is_not() -> None:
    with pytest.raises(TypeError, match="cannot inherit non-frozen dataclass from a frozen one"):

        @dataclass
        class Thawed(Event):  # type: ignore[misc]
            x: int


class Careless(Logger):
    S = State(start=True)

    @S.on(Tupled)
    def _send(self, e: Tupled) -> None:
        self.send(self.ref, Tupled([1]))  # type: ignore[arg-type]


def test_in_a_handler_it_is_the_failure_of_the_sender() -> None:
    made, ref = start(Careless)
    made.post(ref, Tupled(()))
    with pytest.raises(HandlerError, match="EventError: field 'path' of Tupled holds a mutable list"):
        made.run()


def test_references_are_opaque_values_that_travel() -> None:
    made = runtime(node="robot-1")
    ref = made.create(Sink, name="sink")
    assert str(ref) == "sink"
    assert pickle.loads(pickle.dumps(ref)) == ref  # noqa: S301
    assert ref == MachineRef(1, "another name", "robot-1")
    assert hash(ref) == hash(MachineRef(1, "another name", "robot-1"))
    assert ref != MachineRef(1, "sink")
    assert made.create(Sink).name == "Sink-2"
