from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from soter.machine import Event, Halt, Next, Runtime, State, Stay
from tests.machine.helpers import A, B, C, D, Logger, Num, feed, runtime, start


class Base(Event):
    pass


class Derived(Base):
    pass


class Queue(Logger):
    Closed = State(start=True, defer=(A,), ignore=(B,))
    Open = State()

    Closed.on(C, goto=Open)
    Open.on(C, goto=Closed)

    @Closed.on(D)
    def _closed(self, e: D) -> None:
        self.log.append("D closed")

    @Open.on(A, B, D)
    def _open(self, e: A | B | D) -> None:
        self.log.append(type(e).__name__)


def test_deferred_events_wait_and_ignored_ones_are_dropped() -> None:
    log: list[object] = []
    made, ref = start(Queue, log=log)
    feed(made, ref, A(), B(), D(), A())
    assert log == ["D closed"]
    feed(made, ref, C())
    assert log == ["D closed", "A", "A"]


def test_ignored_events_behind_the_one_that_is_taken_stay() -> None:
    log: list[object] = []
    made, ref = start(Queue, log=log)
    feed(made, ref, A(), B(), C(), B(), D())
    assert log == ["A", "B", "D"]


@given(st.lists(st.sampled_from([A, B, C, D]), max_size=12), st.booleans())
def test_the_queue_follows_the_rule(sent: list[type[Event]], at_once: bool) -> None:
    log: list[object] = []
    made, ref = start(Queue, log=log)
    if at_once:
        feed(made, ref, *(event() for event in sent))
    else:
        for event in sent:
            feed(made, ref, event())
    assert log == _by_the_rule(sent)


def _by_the_rule(sent: list[type[Event]]) -> list[str]:
    """Dequeue by scanning from the front; all is queued before the first is taken, or each is taken at once."""
    queue, closed = list(sent), True
    log: list[str] = []
    while True:
        taken = None
        kept = []
        for index, event in enumerate(queue):
            if closed and event is B:
                continue
            if closed and event is A:
                kept.append(event)
                continue
            taken, queue = event, kept + queue[index + 1 :]
            break
        if taken is None:
            return log
        if taken is C:
            closed = not closed
        else:
            log.append("D closed" if closed else taken.__name__)


def test_order_between_machines_is_first_in_first_out_and_machines_take_turns() -> None:
    log: list[object] = []
    made = runtime()
    first, second = made.create(Turn, log=log), made.create(Turn, log=log)
    made.run()
    for n in (1, 2):
        made.post(first, Num(n))
    for n in (10, 20):
        made.post(second, Num(n))
    assert made.run() == 4
    assert log == [1, 10, 2, 20]


class Turn(Logger):
    S = State(start=True)

    @S.on(Num)
    def _num(self, e: Num) -> Next:
        self.log.append(e.n)
        return Stay()


class Kinds(Logger):
    S = State(start=True, defer=(Base,))
    T = State(ignore=(Derived,))
    S.on(A, goto=T)

    @S.on(Derived)
    def _derived(self, e: Derived) -> None:
        self.log.append("derived")

    @T.on(Event)
    def _any(self, e: Event) -> None:
        self.log.append(type(e).__name__)


def test_an_event_class_stands_for_its_subclasses_unless_the_state_names_them() -> None:
    log: list[object] = []
    made, ref = start(Kinds, log=log)
    feed(made, ref, Derived(), Base(), A(), Derived(), B())
    assert log == ["derived", "Base", "B"]


class CatchAll(Logger):
    S = State(start=True)
    T = State(ignore=(Event,))
    U = State()
    S.on(Event, goto=T)
    T.on(A, goto=U)

    @U.on(Halt)
    def _named(self) -> None:
        self.log.append("named")


def test_halt_counts_only_where_it_is_named() -> None:
    for events, state in (((), None), ((B(), B()), None), ((B(), A()), "U")):
        made, ref = start(CatchAll)
        feed(made, ref, *events, Halt())
        assert made.state(ref) == state


class Idle(Logger):
    S = State(start=True, defer=(B,), ignore=(C,))
    T = State(ignore=(B,))

    @S.on(A)
    def _a(self) -> None:
        self.log.append("a")

    S.on(D, goto=T)

    @S.idle
    def _idle(self) -> None:
        self.log.append("idle")


def test_the_idle_handler_runs_when_nothing_can_be_dequeued_once_in_every_run() -> None:
    log: list[object] = []
    made, ref = start(Idle, log=log)
    assert log == ["idle"]
    feed(made, ref, A(), A())
    assert log == ["idle", "a", "a", "idle"]
    feed(made, ref, B(), C())
    assert log[4:] == ["idle"]
    assert made.run() == 1
    feed(made, ref, D())
    assert made.run() == 0
    assert made.state(ref) == "T"


def test_under_a_strategy_an_idle_handler_is_always_enabled() -> None:
    log: list[object] = []
    made: Runtime = runtime(pick=lambda n: 0)
    made.create(Idle, log=log)
    assert made.run(max_steps=41) == 41
    assert log == ["idle"] * 20
