from __future__ import annotations

import pytest

from soter.machine import Goto, Halt, HandlerError, Next, Raise, State, Stay, UnhandledEventError
from tests.machine.helpers import A, B, C, Logger, Num, feed, runtime, start


class Flow(Logger):
    One = State(start=True)
    Two: State[object] = State()
    Three = State()

    @One.entry
    def _enter_one(self) -> None:
        self.log.append("enter One")

    @One.exit
    def _exit_one(self) -> None:
        self.log.append("exit One")

    @One.on(A)
    def _decide(self, e: A) -> Next:
        self.log.append("decide")
        return Goto(self.Two, "payload")

    @One.on(B, goto=Two)
    def _cross(self, e: B) -> None:
        self.log.append("cross")

    @One.on(C)
    def _again(self) -> Next:
        return Goto(self.One)

    @One.on(Num)
    def _count(self, e: Num) -> Next:
        self.log.append(e.n)
        return Stay()

    @Two.entry
    def _enter_two(self, payload: object) -> None:
        self.log.append(("enter Two", payload if isinstance(payload, str) else type(payload).__name__))

    Two.on(C, goto="Three")

    @Three.entry
    def _enter_three(self) -> None:
        self.log.append("enter Three")


def test_the_start_state_is_entered_in_the_first_run() -> None:
    made = runtime()
    log: list[object] = []
    ref = made.create(Flow, log=log)
    assert log == []
    assert made.run() == 1
    assert log == ["enter One"]
    assert made.state(ref) == "One"


def test_a_goto_runs_the_exit_then_the_entry_with_its_payload() -> None:
    log: list[object] = []
    made, ref = start(Flow, log=log)
    feed(made, ref, A())
    assert log == ["enter One", "decide", "exit One", ("enter Two", "payload")]
    assert made.state(ref) == "Two"


def test_a_transition_handler_runs_between_exit_and_entry_and_the_entry_gets_the_event() -> None:
    log: list[object] = []
    made, ref = start(Flow, log=log)
    feed(made, ref, B())
    assert log == ["enter One", "exit One", "cross", ("enter Two", "B")]


def test_a_transition_to_a_state_by_name_needs_no_handler_and_an_entry_need_not_take_the_event() -> None:
    log: list[object] = []
    made, ref = start(Flow, log=log)
    feed(made, ref, B(), C())
    assert log[-1] == "enter Three"


def test_going_to_the_same_state_runs_exit_and_entry() -> None:
    log: list[object] = []
    made, ref = start(Flow, log=log)
    feed(made, ref, C())
    assert log == ["enter One", "exit One", "enter One"]


def test_staying_runs_neither() -> None:
    log: list[object] = []
    made, ref = start(Flow, log=log)
    feed(made, ref, Num(1), Num(2))
    assert log == ["enter One", 1, 2]


class Raiser(Logger):
    S = State(start=True)
    T = State()

    @S.on(A)
    def _a(self) -> Next:
        self.log.append("a")
        self.send(self.ref, Num(0))
        return Raise(Num(1))

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(e.n)

    @S.on(B)
    def _b(self) -> Next:
        return Raise(C())

    S.on(C, goto=T)

    @T.on(A, Num)
    def _late(self, e: A | Num) -> None:
        self.log.append(f"late {type(e).__name__}")


def test_a_raised_event_is_handled_before_the_queue() -> None:
    log: list[object] = []
    made, ref = start(Raiser, log=log)
    feed(made, ref, A(), Num(7))
    # The posted 7 was queued before the handler sent itself 0; the raised 1 overtakes both.
    assert log == ["a", 1, 7, 0]


def test_a_raised_event_can_lead_to_another_state() -> None:
    log: list[object] = []
    made, ref = start(Raiser, log=log)
    feed(made, ref, B(), A())
    assert log == ["late A"]
    assert made.state(ref) == "T"


class RaisesIgnored(Logger):
    S = State(start=True, ignore=(B,), defer=(C,))

    @S.on(A)
    def _a(self) -> Next:
        return Raise(B())

    @S.on(Num)
    def _n(self) -> Next:
        return Raise(C())


def test_a_raised_event_that_is_ignored_is_dropped() -> None:
    made, ref = start(RaisesIgnored)
    feed(made, ref, A())
    assert made.state(ref) == "S"


def test_a_raised_event_cannot_be_deferred() -> None:
    made, ref = start(RaisesIgnored)
    made.post(ref, Num(1))
    with pytest.raises(UnhandledEventError, match="C is not handled"):
        made.run()


class Exits(Logger):
    S = State(start=True)
    T = State()
    S.on(A, goto=T)

    @S.exit
    def _exit(self) -> Next:
        return Goto(self.T)

    @T.on(A, goto=T)
    def _cross(self, e: A) -> Next:
        return Raise(B())


def test_an_exit_handler_cannot_go_elsewhere() -> None:
    made, ref = start(Exits)
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"Goto\(T\).*nothing can be decided.*Exits\.S\.exit \(_exit\)"):
        made.run()


class Crosses(Logger):
    S = State(start=True)

    @S.on(A, goto=S)
    def _cross(self, e: A) -> Next:
        return Raise(B())


def test_a_transition_handler_cannot_raise() -> None:
    made, ref = start(Crosses)
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"Raise\(B\(\)\).*nothing can be decided.*Crosses\.S\.on\(A\)"):
        made.run()


class Halts(Logger):
    S = State(start=True)
    T = State()

    @S.on(A)
    def _halt(self) -> Next:
        return Halt()

    S.on(B, goto=T)

    @S.exit
    def _exit(self) -> None:
        self.log.append("exit")

    @T.on(A)
    def _halt_handled(self) -> Next:
        return Halt()

    @T.on(Halt)
    def _refuse(self) -> Next:
        self.log.append("refused")
        return Goto(self.S)


def test_a_halt_that_is_not_handled_runs_the_exit_and_stops_the_machine_quietly() -> None:
    log: list[object] = []
    made, ref = start(Halts, log=log)
    feed(made, ref, A())
    assert log == ["exit"]
    assert made.state(ref) is None
    feed(made, ref, A())
    assert log == ["exit"]


def test_a_sent_halt_is_an_event_like_any_other() -> None:
    log: list[object] = []
    made, ref = start(Halts, log=log)
    feed(made, ref, Halt())
    assert made.state(ref) is None


def test_a_state_may_handle_halt() -> None:
    log: list[object] = []
    made, ref = start(Halts, log=log)
    feed(made, ref, B(), A())
    assert log == ["exit", "refused"]
    assert made.state(ref) == "S"


def test_an_unhandled_event_is_an_error_after_the_exit_handler() -> None:
    log: list[object] = []
    made, ref = start(Halts, log=log)
    made.post(ref, C())
    with pytest.raises(UnhandledEventError, match=r"C is not handled \[machine Halts-1, state S, event C\(\)\]"):
        made.run()
    assert log == ["exit"]
    assert made.state(ref) is None


class Returns(Logger):
    S = State(start=True)

    @S.on(A)
    def _forgets(self, e: A) -> Next:
        return None  # type: ignore[return-value]

    @S.on(B)
    def _wrong(self, e: B) -> Next:
        return 7  # type: ignore[return-value]

    @S.on(C)
    def _foreign(self, e: C) -> Next:
        return Goto(Flow.Two, 1)

    @S.on(Num)
    def _optional(self, e: Num) -> Next | None:
        return None


def test_none_is_an_error_where_something_else_was_declared() -> None:
    made, ref = start(Returns)
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"returned None.*Returns\.S\.on\(A\) \(_forgets\)"):
        made.run()


def test_none_is_stay_where_it_was_declared_too() -> None:
    made, ref = start(Returns)
    feed(made, ref, Num(1))
    assert made.state(ref) == "S"


def test_anything_else_is_an_error() -> None:
    made, ref = start(Returns)
    made.post(ref, B())
    with pytest.raises(HandlerError, match="returned 7; a handler returns Stay, Goto, Raise or Halt"):
        made.run()


def test_a_state_of_another_class_is_an_error() -> None:
    made, ref = start(Returns)
    made.post(ref, C())
    with pytest.raises(HandlerError, match=r"returned Goto\(Two, 1\), but that is no state of Returns"):
        made.run()


class NotAnEvent(Logger):
    S = State(start=True)

    @S.on(A)
    def _a(self) -> Next:
        return Raise("x")  # type: ignore[arg-type]

    @S.on(B)
    def _b(self) -> Next:
        return Goto("S")  # type: ignore[call-overload, no-any-return]


def test_only_events_are_raised_and_only_states_gone_to() -> None:
    made, ref = start(NotAnEvent)
    made.post(ref, A())
    with pytest.raises(HandlerError, match="only events can be raised"):
        made.run()
    made, ref = start(NotAnEvent)
    made.post(ref, B())
    with pytest.raises(HandlerError, match=r"Goto\(S\), but that is no state"):
        made.run()


class Payloads(Logger):
    S = State(start=True)
    Needs: State[int] = State()
    Takes: State[int] = State()

    @S.on(A)
    def _a(self) -> Next:
        return Goto(self.Needs)  # type: ignore[arg-type]

    @S.on(B)
    def _b(self) -> Next:
        return Goto(self.Takes)  # type: ignore[arg-type]

    @Needs.entry
    def _needs(self, n: int) -> None:
        self.log.append(n)

    @Takes.entry
    def _takes(self, n: int = 5) -> None:
        self.log.append(n)


def test_an_entry_that_needs_a_payload_says_so() -> None:
    made, ref = start(Payloads)
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"takes a payload.*Payloads\.Needs\.entry"):
        made.run()


def test_a_default_stands_for_a_missing_payload() -> None:
    log: list[object] = []
    made, ref = start(Payloads, log=log)
    feed(made, ref, B())
    assert log == [5]


class Forever(Logger):
    S = State(start=True)
    T = State()

    @S.entry
    def _s(self) -> Next:
        return Goto(self.T)

    @T.entry
    def _t(self) -> Next:
        return Goto(self.S)


def test_a_machine_that_never_comes_to_rest_is_an_error() -> None:
    made = runtime()
    made.create(Forever)
    with pytest.raises(HandlerError, match="never comes to rest"):
        made.run()
