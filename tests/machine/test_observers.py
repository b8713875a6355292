"""Who observes a runtime sees every change of state, and what an unhandled event leads to."""

import pytest

from soter.machine import (
    Halt,
    Next,
    State,
    Stay,
    Transition,
    UnhandledEventError,
)
from tests.machine.helpers import A, B, C, D, Logger, ManualClock, feed, runtime, start


class Steps(Logger):
    S = State(start=True)
    T = State()
    S.on(A, goto=T)
    T.on(B, goto=T)

    @T.on(C)
    def _halt(self) -> Next:
        return Halt()

    @T.on(D)
    def _stay(self) -> Next:
        return Stay()


def test_observers_see_every_change_of_state() -> None:
    clock = ManualClock()
    made = runtime(now=clock)
    seen: list[Transition] = []
    stop = made.observe(seen.append)
    ref = made.create(Steps)
    made.run()
    clock.time_s = 1.0
    feed(made, ref, A(), D(), B(), C())
    assert seen == [
        (0.0, ref, None, None, "S"),
        (1.0, ref, "S", A(), "T"),
        (1.0, ref, "T", B(), "T"),
        (1.0, ref, "T", Halt(), None),
    ]
    stop()
    stop()
    made.create(Steps)
    made.run()
    assert len(seen) == 4


def test_what_an_observer_raises_is_not_blamed_on_a_machine() -> None:
    made, ref = start(Steps)
    made.observe(lambda transition: print(1 / 0))
    made.post(ref, A())
    with pytest.raises(ZeroDivisionError):
        made.run()
    assert made.state(ref) == "T"


def test_an_unhandled_event_names_no_handler() -> None:
    made, ref = start(Steps)
    made.post(ref, D())
    with pytest.raises(UnhandledEventError) as caught:
        made.run()
    assert caught.value.handler is None
