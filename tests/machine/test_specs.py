from __future__ import annotations

import pickle

import pytest

from soter.machine import (
    Event,
    Goto,
    Halt,
    LivenessError,
    MachineError,
    MachineRef,
    MisuseError,
    Next,
    Raise,
    Spec,
    SpecError,
    SpecStatus,
    State,
)
from tests.machine.helpers import A, B, C, Logger, ManualClock, Num, To, feed, runtime, start


class Alternates(Spec, observes=(A, B)):
    """Every A is followed by a B before the next A."""

    Calm = State(start=True, cold=True, ignore=(B,))
    Owed = State(hot=True)
    Calm.on(A, goto=Owed)
    Owed.on(B, goto=Calm)

    @Owed.on(A)
    def _twice(self, e: A) -> None:
        raise AssertionError("two A in a row")


class Sink(Logger):
    S = State(start=True, ignore=(Event,))


class Relay(Logger):
    S = State(start=True, ignore=(B,))

    @S.on(To)
    def _to(self, e: To) -> None:
        self.send(e.ref, A())
        self.log.append("still running")

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.announce(B())


class Order(Spec, observes=(Event,)):
    S = State(start=True)

    def __init__(self, log: list[object]) -> None:
        self.log = log

    @S.on(Event)
    def _any(self, e: Event) -> None:
        self.log.append(e)


def test_a_spec_sees_a_send_before_it_is_queued_and_even_if_nobody_gets_it() -> None:
    made, sink = start(Sink)
    log: list[object] = []
    made.monitor(Order, log=log)
    feed(made, sink, A())
    made.post(sink, Num(1))
    made.run(max_steps=0)
    assert log == [A()]
    made.run()
    assert log == [A(), Num(1)]


def test_sends_to_a_halted_machine_are_dropped_but_specs_see_them() -> None:
    made, relay = start(Relay)
    ref = made.create(HaltsAtOnce)
    made.run()
    assert made.state(ref) is None
    log: list[object] = []
    made.monitor(Order, log=log)
    feed(made, relay, To(ref))
    assert log == [To(ref), A()]
    assert Halt() not in log


class HaltsAtOnce(Logger):
    S = State(start=True)

    @S.entry
    def _enter(self) -> Next:
        return Halt()


class WatchHalt(Order, observes=(Event, Halt)):
    @Order.S.on(Halt)
    def _halt(self) -> None:
        self.log.append("halt")


def test_a_spec_that_observes_everything_observes_halt_only_if_that_is_named() -> None:
    made, sink = start(Sink)
    log: list[object] = []
    made.monitor(Order, log=log)
    made.monitor(WatchHalt, log=log)
    feed(made, sink, A(), Halt())
    assert log == [A(), A(), "halt"]
    assert len(made.specs()) == 2


def test_raised_events_are_not_seen() -> None:
    made, ref = start(Quiet)
    log: list[object] = []
    made.monitor(Order, log=log)
    feed(made, ref, A())
    assert log == [A()]


class Quiet(Logger):
    S = State(start=True, ignore=(B,))

    @S.on(A)
    def _a(self) -> Next:
        return Raise(B())


def test_announced_events_go_to_specs_only() -> None:
    made, relay = start(Relay)
    log: list[object] = []
    made.monitor(Order, log=log)
    feed(made, relay, Num(1))
    assert log == [Num(1), B()]


def test_a_violation_is_the_failure_of_the_spec_and_not_of_the_sender() -> None:
    log: list[object] = []
    made, relay = start(Relay, log=log)
    sink = made.create(Sink)
    made.run()
    spec = made.monitor(Alternates, name="alternates")
    feed(made, relay, To(sink))
    made.post(relay, To(sink))
    with pytest.raises(SpecError, match="two A in a row") as caught:
        made.run()
    error = caught.value
    assert (error.machine, error.state, error.event) == ("alternates", "Owed", A())
    assert isinstance(error.__cause__, AssertionError)
    assert log == ["still running", "still running"]
    assert made.state(relay) == "S"
    assert made.state(spec) is None
    assert isinstance(pickle.loads(pickle.dumps(error)), SpecError)  # noqa: S301
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # noqa: S301


def test_an_application_can_carry_on_without_the_spec() -> None:
    failures: list[MachineError] = []
    made = runtime(on_failure=failures.append)
    sink = made.create(Sink)
    made.monitor(Alternates)
    feed(made, sink, A(), A(), A())
    assert [type(failure) for failure in failures] == [SpecError]
    assert made.specs() == []


def test_an_event_that_a_spec_does_not_handle_is_its_failure() -> None:
    made, sink = start(Sink)
    made.monitor(Incomplete)
    feed(made, sink, A())
    made.post(sink, A())
    with pytest.raises(SpecError, match="A is not handled"):
        made.run()


class Incomplete(Spec, observes=(A,)):
    S = State(start=True)
    T = State()

    @S.on(A)
    def _a(self) -> Next:
        return Goto(self.T)


def test_a_hot_state_at_the_end_is_a_liveness_error() -> None:
    made, sink = start(Sink)
    made.monitor(Alternates, name="alternates")
    made.finish()
    feed(made, sink, A())
    with pytest.raises(LivenessError, match="alternates in hot state Owed") as caught:
        made.finish()
    assert caught.value.specs == (("alternates", "Owed"),)
    assert pickle.loads(pickle.dumps(caught.value)).specs == caught.value.specs  # noqa: S301
    feed(made, sink, B())
    made.finish()


class Heat(Spec, observes=(A, B, C)):
    Cold = State(start=True, cold=True)
    Warm = State()
    Hot = State(hot=True)

    @Cold.on(A, B, C)
    @Warm.on(A, B, C)
    @Hot.on(A, B, C)
    def _go(self, e: Event) -> Next:
        return Goto({A: self.Cold, B: self.Warm, C: self.Hot}[type(e)])


def test_temperature_counts_steps_while_hot_and_resets_in_a_cold_state() -> None:
    made, relay = start(Sink)
    busy = made.create(Counter)
    made.run()
    spec = made.monitor(Heat)

    def temperature() -> int:
        (status,) = made.specs()
        return status.temperature

    def work(n: int) -> None:
        feed(made, busy, *(Num(i) for i in range(n)))

    work(3)
    assert made.specs() == [SpecStatus(spec, "Cold", False, 0)]
    feed(made, relay, C())
    work(3)
    assert temperature() == 3
    feed(made, relay, B())
    work(3)
    assert temperature() == 3
    feed(made, relay, C())
    work(2)
    assert made.specs() == [SpecStatus(spec, "Hot", True, 5)]
    feed(made, relay, A())
    assert temperature() == 0


class Counter(Logger):
    S = State(start=True)

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(e.n)


def test_a_limit_of_the_temperature_can_be_set() -> None:
    made = runtime(temperature_limit=5)
    sink, busy = made.create(Sink), made.create(Counter)
    made.monitor(Heat, name="heat")
    feed(made, sink, C())
    made.run()
    for n in range(9):
        made.post(busy, Num(n))
    with pytest.raises(LivenessError, match="hot for more than 5 steps: heat in hot state Hot"):
        made.run()


class Meddler(Spec, observes=(Num,)):
    S = State(start=True)

    @S.on(Num)
    def _num(self, e: Num) -> None:
        name = ("send", "create", "receive", "choose", "after", "announce")[e.n]
        getattr(self, name)()


@pytest.mark.parametrize("n", range(6))
def test_a_spec_only_watches(n: int) -> None:
    made, sink = start(Sink)
    made.monitor(Meddler)
    made.post(sink, Num(n))
    with pytest.raises(SpecError, match="Meddler is a spec and only watches") as caught:
        made.run()
    assert isinstance(caught.value.__cause__, MisuseError)


def test_other_missing_attributes_are_as_usual() -> None:
    with pytest.raises(AttributeError, match="'Meddler' object has no attribute 'nothing'"):
        Meddler().nothing  # type: ignore[attr-defined]  # noqa: B018


def test_nothing_can_be_sent_to_a_spec() -> None:
    made = runtime()
    spec = made.monitor(Alternates)
    with pytest.raises(MisuseError, match="is a spec"):
        made.post(spec, A())


class BadStart(Spec, observes=(A,)):
    S = State(start=True, hot=True)

    @S.entry
    def _enter(self) -> None:
        raise ValueError("no")


def test_a_spec_that_cannot_start_is_not_attached() -> None:
    made = runtime()
    with pytest.raises(SpecError, match="ValueError: no"):
        made.monitor(BadStart)
    made.finish()


def test_timers_and_posts_are_seen_when_they_are_sent() -> None:
    clock = ManualClock()
    made = runtime(now=clock)
    log: list[object] = []
    sink: MachineRef = made.create(Sink)
    made.monitor(Order, log=log)
    made.call_at(1.0, sink, A())
    made.run()
    assert log == []
    clock.time_s = 1.0
    made.run()
    assert log == [A()]
