from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from soter.machine import Event, Goto, HandlerError, MachineRef, Next, Runtime, Spec, State, Stay
from tests.machine.helpers import A, B, C, D, Logger, ManualClock, Num, Replay, To, explore, runtime, start


class Sink(Logger):
    S = State(start=True)

    @S.on(Event)
    def _any(self, e: Event) -> None:
        self.log.append(e.n if isinstance(e, Num) else type(e).__name__)


class Sender(Logger):
    """Sends some numbers when it starts."""

    S = State(start=True)

    def __init__(self, to: MachineRef, numbers: tuple[int, ...]) -> None:
        super().__init__()
        self.to = to
        self.numbers = numbers

    @S.entry
    def _enter(self) -> None:
        for n in self.numbers:
            self.send(self.to, Num(n))


class Watch(Spec, observes=(Num, B)):
    S = State(start=True)

    def __init__(self, log: list[int]) -> None:
        self.log = log

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(e.n)

    @S.on(B)
    def _b(self) -> None:
        self.log.append(-1)


Orders = tuple[tuple[int, ...], tuple[int, ...]]


def _two_senders(first: tuple[int, ...], second: tuple[int, ...]) -> Callable[[Runtime], Callable[[], Orders]]:
    """Two machines send numbers to a third; the outcome is the order that a spec saw and that of the queue."""

    def program(made: Runtime) -> Callable[[], Orders]:
        seen: list[int] = []
        queued: list[int] = []
        made.monitor(Watch, log=seen)
        sink = made.create(Sink, log=queued)
        made.create(Sender, to=sink, numbers=first)
        made.create(Sender, to=sink, numbers=second)
        return lambda: (tuple(seen), tuple(queued))

    return program


def test_specs_are_told_before_the_scheduling_point_of_a_send() -> None:
    outcomes, _ = explore(_two_senders((1,), (2,)))
    # Both may be told of one order while the queue has the other: 4 outcomes, where a send at once would give 2.
    assert sorted(outcomes) == [((1, 2), (1, 2)), ((1, 2), (2, 1)), ((2, 1), (1, 2)), ((2, 1), (2, 1))]


def test_every_send_of_a_handler_has_a_scheduling_point_of_its_own() -> None:
    outcomes, _ = explore(_two_senders((1, 2), (3,)))
    assert {queued for _, queued in outcomes} == {(1, 2, 3), (1, 3, 2), (3, 1, 2)}
    # A handler's own sends are told in their order, each when its turn has come.
    assert ((1, 3, 2), (1, 3, 2)) in outcomes
    assert all(seen.index(1) < seen.index(2) for seen, _ in outcomes)
    assert all(not (seen == (1, 2, 3) and queued == (3, 1, 2)) for seen, queued in outcomes)


def test_the_number_of_schedules_is_pinned() -> None:
    assert explore(_two_senders((1,), (2,)))[1] == 84


class Creator(Logger):
    S = State(start=True)

    def __init__(self, sink: MachineRef) -> None:
        super().__init__()
        self.sink = sink

    @S.entry
    def _enter(self) -> None:
        self.create(Sender, to=self.sink, numbers=(1,))
        self.send(self.sink, Num(2))


def test_a_created_machine_starts_in_a_step_of_its_own() -> None:
    def program(made: Runtime) -> Callable[[], object]:
        log: list[object] = []
        made.create(Creator, sink=made.create(Sink, log=log))
        return lambda: tuple(log)

    outcomes, _ = explore(program)
    assert sorted(outcomes, key=str) == [(1, 2), (2, 1)]


class Announcer(Logger):
    S = State(start=True)

    def __init__(self, sink: MachineRef) -> None:
        super().__init__()
        self.sink = sink

    @S.entry
    def _enter(self) -> None:
        self.announce(B())
        self.send(self.sink, Num(1))
        self.announce(B())
        self.send(self.sink, Num(2))
        self.announce(B())


@pytest.mark.parametrize("pick", [None, lambda n: 0])
def test_announcements_keep_their_place_among_the_sends(pick: Callable[[int], int] | None) -> None:
    made = runtime(pick=pick)
    log: list[int] = []
    made.monitor(Watch, log=log)
    made.create(Announcer, sink=made.create(Sink))
    made.run()
    assert log == [-1, 1, -1, 2, -1]


class Chooser(Logger):
    S = State(start=True)

    @S.entry
    def _enter(self) -> None:
        self.log.append(self.choose(3))
        self.log.append(self.choose(("x", "y")))
        self.log.append(self.choose(1))


def test_choices_of_machines_are_explored_too() -> None:
    def program(made: Runtime) -> Callable[[], object]:
        log: list[object] = []
        made.create(Chooser, log=log)
        return lambda: tuple(log)

    outcomes, runs = explore(program)
    assert outcomes == [(n, c, 0) for n in range(3) for c in "xy"]
    assert runs == 6


def test_a_live_runtime_takes_the_first_option() -> None:
    log: list[object] = []
    start(Chooser, log=log)
    assert log == [0, "x", 0]


class Undecided(Logger):
    S = State(start=True)

    @S.entry
    def _enter(self) -> None:
        self.choose(())


def test_there_must_be_something_to_choose() -> None:
    made = runtime()
    made.create(Undecided)
    with pytest.raises(HandlerError, match="ValueError: cannot choose one of 0"):
        made.run()


def test_a_pick_out_of_range_is_an_error() -> None:
    made = runtime(pick=lambda n: n)
    made.create(Sink)
    made.create(Sink)
    with pytest.raises(ValueError, match=r"pick\(2\) returned 2; it must be from 0 to 1"):
        made.run()


def test_pick_learns_who_the_candidates_are() -> None:
    offered: list[list[str]] = []

    def pick(n: int) -> int:
        offered.append([ref.name for ref in made.candidates])
        return n - 1

    made = runtime(pick=pick)
    sink = made.create(Sink, name="sink")
    made.create(Chooser, name="chooser")
    made.post(sink, A())
    made.run()
    assert offered[0] == ["sink", "chooser", "outside"]
    assert [] in offered
    assert made.candidates == ()


class PingPong(Logger):
    S = State(start=True)

    @S.on(To)
    async def _to(self, e: To) -> None:
        self.send(e.ref, To(self.ref))
        got = await self.receive(A, B)
        self.log.append(type(got).__name__)
        if isinstance(got, A):
            self.send(e.ref, B())


def test_a_run_is_repeated_by_its_choices() -> None:
    def trace(choices: list[int]) -> tuple[list[tuple[int, int]], list[object]]:
        replay = Replay(choices)
        made = runtime(pick=replay.pick)
        log: list[object] = []
        made.observe(log.append)
        refs = [made.create(PingPong, name=str(n)) for n in range(3)]
        for ref, other in zip(refs, refs[1:] + refs[:1], strict=True):
            made.post(ref, To(other))
            made.post(ref, A())
        made.run()
        return replay.taken, log

    choices = [1, 2, 0, 1, 1, 2, 3, 0, 1]
    taken, log = trace(choices)
    assert [index for index, _ in taken[: len(choices)]] == choices
    assert trace([index for index, _ in taken]) == (taken, log)


class Caller(Logger):
    """Asks another machine, which interrupts it, while there is more in its queue."""

    S = State(start=True)

    def __init__(self, log: list[object], to: MachineRef) -> None:
        super().__init__(log)
        self.to = to

    @S.on(A)
    def _a(self) -> None:
        self.send(self.to, To(self.ref))

    @S.on(B, C)
    def _other(self, e: B | C) -> None:
        self.log.append(type(e).__name__)

    @S.interrupt(D)
    def _interrupt(self) -> Next:
        self.log.append("D")
        return Stay()


class Interrupter(Logger):
    S = State(start=True)

    @S.on(To)
    def _to(self, e: To) -> None:
        self.send(e.ref, D())


def _calls(made: Runtime) -> Callable[[], object]:
    log: list[object] = []
    caller = made.create(Caller, log=log, to=made.create(Interrupter))
    for event in (A(), B(), C()):
        made.post(caller, event)
    return lambda: tuple(log)


def test_an_interrupt_can_come_before_every_dequeue() -> None:
    outcomes, _ = explore(_calls)
    assert set(outcomes) == {("D", "B", "C"), ("B", "D", "C"), ("B", "C", "D")}


def test_a_live_run_is_one_of_the_schedules() -> None:
    made = runtime()
    outcome = _calls(made)
    made.run()
    assert outcome() in explore(_calls)[0]


Script = tuple[tuple[tuple[int, bool], ...], ...]


class Actor(Logger):
    """For every event with n > 0 follows its script; some events interrupt, some are received, some deferred."""

    S = State(start=True, defer=(A,))
    T = State(ignore=(B,))

    def __init__(self, me: int, script: Script, log: list[object], others: list[MachineRef]) -> None:
        super().__init__(log)
        self.me, self.script, self.others = me, script, others

    @S.on(Num)
    async def _num(self, e: Num) -> Next:
        self.log.append((self.me, e.n))
        for other, interrupts in self.script[self.me] if e.n > 0 else ():
            self.send(self.others[other], B() if interrupts else Num(e.n - 1))
            self.send(self.others[other], A())
        if e.n == 1:
            got = await self.receive(A, Num)
            self.log.append((self.me, "got", type(got).__name__))
        return Stay()

    @S.interrupt(B)
    def _b(self) -> Next:
        self.log.append((self.me, "B"))
        return Goto(self.T)

    @T.on(Num)
    def _late(self, e: Num) -> None:
        self.log.append((self.me, "late", e.n))

    T.on(A, goto=S)


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.filter_too_much])
@given(
    st.tuples(*[st.lists(st.tuples(st.integers(0, 1), st.booleans()), max_size=2).map(tuple)] * 2),
    st.integers(0, 1),
)
def test_a_live_run_of_any_program_is_one_of_the_schedules(script: Script, n: int) -> None:
    assume(sum(len(actions) for actions in script) <= 2)

    def outcome(made: Runtime) -> tuple[list[object], ...]:
        logs: tuple[list[object], ...] = ([], [])
        refs: list[MachineRef] = []
        for me in range(2):
            refs.append(made.create(Actor, me=me, script=script, log=logs[me], others=refs))
        made.post(refs[0], Num(1))
        if n:
            made.post(refs[1], Num(1))
        made.run()
        return logs

    live = outcome(runtime())
    # There are too many schedules to try them all, but few outcomes: some of the schedules show each of them.
    choose = random.Random(1).randrange
    assert any(outcome(runtime(pick=choose)) == live for _ in range(3000))


def test_timers_and_posts_take_part_in_the_scheduling() -> None:
    def program(made: Runtime) -> Callable[[], object]:
        log: list[object] = []
        sink = made.create(Sink, log=log)
        made.call_at(0.0, sink, A())
        made.post(sink, B())
        made.create(Sender, to=sink, numbers=(1,))
        return lambda: tuple(log)

    outcomes, _ = explore(program)
    assert set(outcomes) == {("B", "A", 1), ("B", 1, "A"), (1, "B", "A")}


def test_steps_can_be_bounded_and_continued() -> None:
    clock = ManualClock()
    log: list[object] = []
    made = runtime(now=clock)
    sink = made.create(Sink, log=log)
    for n in range(5):
        made.post(sink, Num(n))
    assert made.run(max_steps=0) == 0
    assert made.run(max_steps=3) == 3
    assert log == [0, 1]
    assert made.run() == 3
    assert made.steps == 6
    assert log == [0, 1, 2, 3, 4]
