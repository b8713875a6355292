from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from soter.machine import Machine, MachineDefinitionError, Spec, State
from tests.machine.helpers import A, B


def _no_start() -> None:
    class M(Machine):
        S = State()


def _two_starts() -> None:
    class M(Machine):
        S = State(start=True)
        T = State(start=True)


def _inherited_second_start() -> None:
    class M(Machine):
        S = State(start=True)

    class N(M):
        T = State(start=True)


def _two_handlers() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)
        def _a(self) -> None: ...

        @S.on(B, A)
        def _b(self) -> None: ...


def _two_entries() -> None:
    class M(Machine):
        S = State(start=True)

        @S.entry
        def _a(self) -> None: ...

        @S.entry
        def _b(self) -> None: ...


def _handled_and_deferred() -> None:
    class M(Machine):
        S = State(start=True, defer=(A,))

        @S.on(A)
        def _a(self) -> None: ...


def _deferred_and_ignored() -> None:
    class M(Machine):
        S = State(start=True, defer=(A,), ignore=(A,))


def _handled_and_interrupting() -> None:
    class M(Machine):
        S = State(start=True)
        S.on(A, goto=S)

        @S.interrupt(A)
        def _a(self) -> None: ...


def _unknown_name() -> None:
    class M(Machine):
        Waiting = State(start=True)
        Waiting.on(A, goto="Wating")


def _foreign_target() -> None:
    class M(Machine):
        S = State(start=True)

    class N(Machine):
        T = State(start=True)
        T.on(A, goto=M.S)


def _foreign_state() -> None:
    class M(Machine):
        S = State(start=True)

    class N(Machine):
        T = State(start=True)

        @M.S.on(A)
        def _a(self) -> None: ...


def _no_event() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(int)  # type: ignore[type-var]
        def _a(self) -> None: ...


def _no_events() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on()
        def _a(self) -> None: ...


def _deferred_no_event() -> None:
    class M(Machine):
        S = State(start=True, defer=("A",))  # type: ignore[arg-type]


def _too_many_parameters() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)  # type: ignore[arg-type]
        def _a(self, e: A, f: int) -> None: ...


def _keyword_parameter() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)  # type: ignore[arg-type]
        def _a(self, e: A, *, f: int) -> None: ...


def _exit_with_parameter() -> None:
    class M(Machine):
        S = State(start=True)

        @S.exit  # type: ignore[arg-type]
        def _a(self, e: A) -> None: ...


def _no_self() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)  # type: ignore[arg-type]
        def _a() -> None: ...


def _generator() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)
        def _a(self) -> Any:
            yield 1


def _static() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)
        @staticmethod
        def _a(e: A) -> None: ...


def _same_name() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)
        def _(self) -> None: ...

        @S.on(B)
        def _(self) -> None: ...


def _wrapped() -> None:
    def other(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args: function(*args)

    class M(Machine):
        S = State(start=True)

        @other
        @S.on(A)
        def _a(self) -> None: ...


def _two_names() -> None:
    class M(Machine):
        S = State(start=True)
        T = S


def _redefined() -> None:
    class M(Machine):
        S = State(start=True)

    class N(M):
        S = State(start=True)


def _hidden() -> None:
    class M(Machine):
        S = State(start=True)

    class N(M):
        S = 1  # type: ignore[assignment]


def _replaced_handler() -> None:
    class M(Machine):
        S = State(start=True)

        @S.on(A)
        def _a(self) -> None: ...

    class N(M):
        _a = None  # type: ignore[assignment]


def _reserved() -> None:
    class M(Machine):
        S = State(start=True)

        def send(self) -> None: ...  # type: ignore[override]


def _hot_machine() -> None:
    class M(Machine):
        S = State(start=True, hot=True)


def _hot_and_cold() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True, hot=True, cold=True)


def _deferring_spec() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True, defer=(A,))


def _async_spec() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True)

        @S.on(A)
        async def _a(self) -> None: ...


def _idle_spec() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True)

        @S.idle
        def _a(self) -> None: ...


def _interrupting_spec() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True)

        @S.interrupt(A)
        def _a(self) -> None: ...


def _blind_spec() -> None:
    class M(Spec):
        S = State(start=True)


def _unobserved() -> None:
    class M(Spec, observes=(A,)):
        S = State(start=True)

        @S.on(B)
        def _b(self) -> None: ...


def _observes_no_event() -> None:
    class M(Spec, observes=(int,)):  # type: ignore[arg-type]
        S = State(start=True)


@pytest.mark.parametrize(
    ("define", "message"),
    [
        (_no_start, "M has no start state: declare one with State(start=True), or the class with abstract=True"),
        (_two_starts, "M has more than one start state: S and T; keep start=True on one of them"),
        (_inherited_second_start, "N has more than one start state: S and T"),
        (_two_handlers, "M.S.on(B, A) (_b): state M.S already says what to do with A"),
        (_two_entries, "M.S.entry (_b): state M.S already says what to do with entry"),
        (_handled_and_deferred, "M.S.on(A) (_a): state M.S already says what to do with A"),
        (_deferred_and_ignored, "M.S: A is deferred or ignored more than once"),
        (_handled_and_interrupting, "M.S.interrupt(A) (_a): state M.S already says what to do with A"),
        (_unknown_name, "M.Waiting.on(A): goto='Wating' is no state of M, did you mean 'Waiting'?"),
        (_foreign_target, "N.T.on(A): goto=<State M.S> is no state of N"),
        (_foreign_state, "N._a handles <State M.S>, which is no state of N"),
        (_no_event, "M.S.on(int) (_a): int is not an event class"),
        (_no_events, "M.S.on (_a): name at least one event class"),
        (_deferred_no_event, "M.S.defer: 'A' is not an event class"),
        (_too_many_parameters, "M.S.on(A) (_a): this handler is called with self and at most one payload or event"),
        (_keyword_parameter, "M.S.on(A) (_a): this handler is called with self and at most one payload or event"),
        (_exit_with_parameter, "M.S.exit (_a): this handler is called with self, but it is declared as (self, e"),
        (_no_self, "M.S.on(A) (_a): this handler is called with self and at most one"),
        (_generator, "M.S.on(A) (_a): a handler is a function or an async function and cannot yield"),
        (_static, "M.S.on(A) (_a): a handler is a method, not a staticmethod"),
        (_same_name, "M.S.on(A) (_): _ is not this method when the class is complete; give every handler its own name"),
        (_wrapped, "M.S.on(A) (_a): _a is not this method when the class is complete"),
        (_two_names, "M.S and M.T are the same State object; give each its own State()"),
        (_redefined, "N.S: this is already a state of M; a subclass keeps inherited states"),
        (_hidden, "N.S: this is already a state of M"),
        (_replaced_handler, "M.S.on(A) (_a): N has replaced this method by something that is none"),
        (_reserved, "M.send: the name belongs to the base class; choose another one"),
        (_hot_machine, "M.S: only states of specs are hot or cold"),
        (_hot_and_cold, "M.S: a state cannot be both hot and cold"),
        (_deferring_spec, "M.S: a spec sees events when they are sent and cannot defer them"),
        (_async_spec, "M.S.on(A) (_a): a spec cannot wait; make this a plain function"),
        (_idle_spec, "M.S.idle (_a): a spec runs only when an event is sent and has no idle handler"),
        (_interrupting_spec, "M.S.interrupt(A) (_a): a spec has nothing to interrupt; use on(...)"),
        (_blind_spec, "M observes nothing: class M(Spec, observes=(SomeEvent,))"),
        (_unobserved, "M.S: B is not in observes; add it there"),
        (_observes_no_event, "M: observes=<class 'int'> is not an event class"),
    ],
)
def test_a_class_that_is_wrong_is_refused_where_it_is_written(define: Callable[[], None], message: str) -> None:
    with pytest.raises(MachineDefinitionError) as caught:
        define()
    assert message in str(caught.value)
