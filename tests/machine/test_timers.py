"""Timers: when they fire, in which order, and how they are cancelled."""

import pytest

from soter.machine import (
    Halt,
    HandlerError,
    Runtime,
    State,
    Timer,
)
from tests.machine.helpers import A, B, C, Logger, ManualClock, Num, feed, runtime, start


class Timed(Logger):
    S = State(start=True)
    timer: Timer

    @S.on(Num)
    def _start(self, e: Num) -> None:
        self.timer = self.after(e.n, A())

    @S.on(A, C)
    def _fired(self, e: A | C) -> None:
        self.log.append((type(e).__name__, self.now()))

    @S.on(B)
    def _cancel(self) -> None:
        self.log.append(self.timer.cancel())


def _next_timer(made: Runtime) -> float | None:
    return made.next_timer_s


def test_timers_fire_at_their_time_in_the_order_of_their_times() -> None:
    clock = ManualClock()
    made = runtime(now=clock)
    log: list[object] = []
    ref = made.create(Timed, log=log)
    assert _next_timer(made) is None
    feed(made, ref, Num(3))
    made.call_at(2.0, ref, C())
    made.call_at(2.0, ref, A())
    assert _next_timer(made) == 2.0
    assert made.run() == 0
    clock.time_s = 2.0
    assert not made.idle
    assert made.run() == 2
    clock.time_s = 3.5
    assert made.run() == 1
    assert log == [("C", 2.0), ("A", 2.0), ("A", 3.5)]
    assert made.next_timer_s is None


def test_a_timer_can_be_cancelled_once() -> None:
    clock = ManualClock()
    made = runtime(now=clock)
    log: list[object] = []
    ref = made.create(Timed, log=log)
    feed(made, ref, Num(1), B(), B())
    assert log == [True, False]
    assert made.next_timer_s is None
    timer = made.call_at(1.0, ref, A())
    assert (timer.active, timer.time_s) == (True, 1.0)
    clock.time_s = 2.0
    made.run()
    assert not timer.active
    assert not timer.cancel()
    assert log == [True, False, ("A", 2.0)]


def test_a_time_in_the_past_is_due_at_once() -> None:
    log: list[object] = []
    made, ref = start(Timed, log=log)
    made.call_at(-5.0, ref, A())
    assert made.run() == 1
    assert log == [("A", 0.0)]


def test_a_timer_of_a_halted_machine_does_nothing() -> None:
    clock = ManualClock()
    made = runtime(now=clock)
    ref = made.create(Timed)
    feed(made, ref, Num(1), Halt())
    clock.time_s = 1.0
    assert made.run() == 0


@pytest.mark.parametrize("time_s", [float("nan"), float("inf")])
def test_times_are_finite(time_s: float) -> None:
    made, ref = start(Timed)
    with pytest.raises(ValueError, match="finite number of seconds"):
        made.call_at(time_s, ref, A())
    made.post(ref, Num(-1))
    with pytest.raises(HandlerError, match="a delay must be a finite number of seconds, 0 or more, not -1"):
        made.run()


def test_the_default_clock_is_the_steady_one() -> None:
    made = Runtime()
    log: list[object] = []
    ref = made.create(Timed, log=log)
    made.call_at(0.0, ref, A())
    made.run()
    assert len(log) == 1
