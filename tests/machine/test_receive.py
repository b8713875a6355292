from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Generator

import pytest

from soter.machine import Goto, Halt, HandlerError, MachineRef, Next, Runtime, State, Stay, UnhandledEventError
from tests.machine.helpers import A, B, C, D, Logger, Num, To, feed, runtime, start


class Receiver(Logger):
    S = State(start=True, ignore=(B,), defer=(C,))
    T = State()

    @S.on(A)
    async def _a(self, e: A) -> Next:
        self.log.append("wait")
        got = await self.receive(Num, D, match=lambda g: not isinstance(g, Num) or g.n > 1)
        self.log.append(got)
        return Goto(self.T)

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(("handled", e.n))

    @T.on(A, B, C, Num)
    def _rest(self, e: A | B | C) -> None:
        self.log.append(type(e).__name__)


def test_everything_not_listed_stays_queued_whatever_the_state_says() -> None:
    log: list[object] = []
    made, ref = start(Receiver, log=log)
    feed(made, ref, A())
    feed(made, ref, B(), C(), A(), Num(1))
    assert log == ["wait"]
    feed(made, ref, Num(2))
    assert log == ["wait", Num(2), "B", "C", "A", "Num"]


def test_a_receive_scans_the_queue_before_it_blocks() -> None:
    log: list[object] = []
    made, ref = start(Receiver, log=log)
    feed(made, ref, C(), A(), B(), Num(0), D(), Num(5))
    assert log == ["wait", D(), "C", "B", "Num", "Num"]


def test_nobody_is_blocked_until_nothing_can_be_done() -> None:
    made, ref = start(Receiver)
    assert made.blocked() == []
    made.post(ref, A())
    assert made.blocked() == []
    made.run()
    (blocked,) = made.blocked()
    assert blocked == (ref, "S", "Receiver.S.on(A) (_a)", (Num, D))
    feed(made, ref, Num(0))
    assert [b.machine for b in made.blocked()] == [ref]
    feed(made, ref, D())
    assert made.blocked() == []


class Halted(Logger):
    S = State(start=True)
    T = State()

    @S.entry
    async def _enter(self) -> Next:
        try:
            self.log.append(await self.receive(A))
        finally:
            self.log.append("finally")
        return Goto(self.T)

    @S.exit
    def _exit(self) -> None:
        self.log.append("exit")

    @T.entry
    async def _explicit(self) -> None:
        self.log.append(await self.receive(Halt, B))


def test_halt_is_received_without_being_listed_and_halts() -> None:
    log: list[object] = []
    made, ref = start(Halted, log=log)
    feed(made, ref, Num(1), Halt(), A())
    assert log == ["finally", "exit"]
    assert made.state(ref) is None


def test_a_listed_halt_is_a_value() -> None:
    log: list[object] = []
    made, ref = start(Halted, log=log)
    feed(made, ref, A(), Halt())
    assert log == [A(), "finally", "exit", Halt()]
    assert made.state(ref) == "T"


class HandlesHalt(Logger):
    S = State(start=True)

    @S.on(A)
    async def _a(self) -> None:
        await self.receive(B, match=lambda b: False)

    @S.on(Halt)
    def _halt(self) -> None:
        self.log.append("no")


def test_a_received_halt_is_raised_in_the_state() -> None:
    log: list[object] = []
    made, ref = start(HandlesHalt, log=log)
    feed(made, ref, A(), Halt())
    assert log == ["no"]
    assert made.state(ref) == "S"


class WaitingExit(Logger):
    S = State(start=True)
    T = State()

    S.on(A, goto=T)

    @S.exit
    async def _exit(self) -> None:
        self.log.append(await self.receive(Num))

    @T.entry
    def _enter(self, e: A) -> None:
        self.log.append(e)


def test_an_exit_handler_may_receive() -> None:
    log: list[object] = []
    made, ref = start(WaitingExit, log=log)
    feed(made, ref, A())
    assert made.state(ref) == "S"
    feed(made, ref, Num(3))
    assert log == [Num(3), A()]
    assert made.state(ref) == "T"


def test_a_halt_received_by_an_exit_handler_stops_the_machine() -> None:
    log: list[object] = []
    made, ref = start(WaitingExit, log=log)
    feed(made, ref, A(), Halt())
    assert log == []
    assert made.state(ref) is None


def test_an_unhandled_event_is_reported_after_an_exit_that_receives() -> None:
    made, ref = start(WaitingExit)
    feed(made, ref, B())
    made.post(ref, Num(1))
    with pytest.raises(UnhandledEventError, match=r"B is not handled.*event B\(\)"):
        made.run()


def test_an_unhandled_event_is_reported_even_if_a_halt_ends_the_exit() -> None:
    made, ref = start(WaitingExit)
    feed(made, ref, B())
    made.post(ref, Halt())
    with pytest.raises(UnhandledEventError, match="B is not handled"):
        made.run()


class Helper(Logger):
    S = State(start=True)

    @S.entry
    async def _enter(self) -> Next:
        self.log.append(await self._sum())
        return Stay()

    async def _sum(self) -> int:
        return (await self.receive(Num)).n + (await self.receive(Num)).n

    @S.on(A)
    def _delegates(self) -> Next:
        return self._enter()  # type: ignore[return-value]


def test_handlers_may_await_helpers_that_receive() -> None:
    log: list[object] = []
    made, ref = start(Helper, log=log)
    feed(made, ref, Num(1), Num(2))
    assert log == [3]


def test_a_plain_handler_may_return_a_coroutine() -> None:
    log: list[object] = []
    made, ref = start(Helper, log=log)
    feed(made, ref, Num(1), Num(2), A(), Num(3), Num(4))
    assert log == [3, 7]


def test_each_receive_ends_a_step() -> None:
    made, ref = start(Loop)
    feed(made, ref)
    made.post(ref, A())
    assert made.run(max_steps=100) == 100


class Loop(Logger):
    S = State(start=True)

    @S.on(A)
    async def _a(self) -> None:
        while True:
            self.send(self.ref, B())
            await self.receive(B)


class _Future:
    def __await__(self) -> Generator[str]:
        yield "something"


class Awaits(Logger):
    S = State(start=True)

    @S.on(A)
    async def _sleep(self) -> None:
        try:
            await asyncio.sleep(0)
        finally:
            self.log.append("closed")

    @S.on(B)
    async def _future(self) -> None:
        awaitable: Awaitable[None] = _Future()
        await awaitable

    @S.on(C)
    async def _nothing(self) -> None:
        await self.receive()

    @S.on(D)
    async def _no_event(self) -> None:
        await self.receive(int)  # type: ignore[type-var]

    @S.on(Num)
    async def _match(self) -> None:
        await self.receive(A, match=lambda a: 1 / 0 > 0)


def test_awaiting_anything_else_is_an_error_that_names_the_handler() -> None:
    log: list[object] = []
    made, ref = start(Awaits, log=log)
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"awaited something else.*NoneType, in line \d+.*\(_sleep\)"):
        made.run()
    assert log == ["closed"]
    made, ref = start(Awaits)
    made.post(ref, B())
    with pytest.raises(HandlerError, match=r"awaited something else.*: str, in line.*on\(B\) \(_future\)"):
        made.run()


def test_receive_needs_event_classes() -> None:
    for event in (C(), D()):
        made, ref = start(Awaits)
        made.post(ref, event)
        with pytest.raises(HandlerError, match=r"receive\(\) takes event classes"):
            made.run()


def test_a_match_that_raises_is_the_failure_of_the_receiver() -> None:
    made, ref = start(Awaits)
    feed(made, ref, Num(1))
    sender = made.create(Sender)
    made.run()
    made.post(sender, To(ref))
    with pytest.raises(HandlerError, match=r"match raised ZeroDivisionError.*machine Awaits-1"):
        made.run()
    assert made.state(sender) == "S"


def test_a_match_that_raises_on_a_queued_event_is_too() -> None:
    made, ref = start(Awaits)
    made.post(ref, Num(1))
    made.post(ref, A())
    with pytest.raises(HandlerError, match=r"match raised ZeroDivisionError.*machine Awaits-1"):
        made.run()


class Sender(Logger):
    S = State(start=True)

    @S.on(To)
    def _to(self, e: To) -> None:
        self.send(e.ref, A())


class Thief(Logger):
    S = State(start=True)
    loot: Awaitable[A] | None = None

    @S.on(A)
    async def _lend(self) -> None:
        Thief.loot = self.receive(A)
        await self.receive(B)

    @S.on(C)
    async def _steal(self) -> None:
        assert Thief.loot is not None
        await Thief.loot


def test_the_receive_of_another_machine_cannot_be_awaited() -> None:
    made, first = start(Thief)
    second = made.create(Thief)
    feed(made, first, A())
    made.post(second, C())
    with pytest.raises(HandlerError, match=r"receive\(\) of Thief-1 was called while none of its handlers runs"):
        made.run()


def test_deadlock_is_when_nobody_can_do_anything_and_somebody_waits() -> None:
    made: Runtime = runtime()
    refs: list[MachineRef] = [made.create(Philosopher, name=name) for name in ("one", "two")]
    made.run()
    for ref, other in zip(refs, reversed(refs), strict=True):
        made.post(ref, To(other))
    made.run()
    assert [blocked.machine.name for blocked in made.blocked()] == ["one", "two"]
    assert made.next_timer_s is None


class Philosopher(Logger):
    S = State(start=True)

    @S.on(To)
    async def _to(self, e: To) -> None:
        await self.receive(A)
        self.send(e.ref, A())
