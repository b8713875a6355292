from __future__ import annotations

import pytest

from soter.machine import Goto, Halt, HandlerError, Next, Raise, State, Stay
from tests.machine.helpers import A, B, C, D, Logger, Num, feed, runtime, start


class Mission(Logger):
    Waiting = State(start=True)
    Executing: State[A] = State(defer=(A,))
    Yielding = State()

    Waiting.on(A, goto=Executing)

    @Waiting.on(Num)
    def _ordinary(self, e: Num) -> None:
        self.log.append(("ordinary", e.n))

    @Executing.entry
    async def _execute(self, e: A) -> Next:
        self.log.append("execute")
        try:
            await self.receive(B)
            self.log.append("done")
        finally:
            self.log.append("closed")
        return Goto(self.Waiting)

    @Executing.interrupt(Num)
    def _disengaged(self, e: Num) -> Next:
        self.log.append(("interrupt", e.n))
        return Goto(self.Yielding) if e.n else Stay()

    @Executing.exit
    def _exit(self) -> None:
        self.log.append("exit")

    @Yielding.entry
    async def _yield(self) -> Next:
        self.log.append(("yielded", (await self.receive(Num)).n))
        return Goto(self.Waiting)


def test_an_interrupt_abandons_the_handler_that_waits() -> None:
    log: list[object] = []
    made, ref = start(Mission, log=log)
    feed(made, ref, A())
    assert log == ["execute"]
    feed(made, ref, Num(1))
    assert log == ["execute", "closed", ("interrupt", 1), "exit"]
    assert made.state(ref) == "Yielding"


def test_a_state_that_does_not_list_it_sees_an_ordinary_event() -> None:
    log: list[object] = []
    made, ref = start(Mission, log=log)
    feed(made, ref, Num(5))
    feed(made, ref, A(), Num(1), Num(2))
    assert log == [("ordinary", 5), "execute", "closed", ("interrupt", 1), "exit", ("yielded", 2)]


def test_an_interrupt_is_delivered_at_the_next_await_even_if_that_could_receive() -> None:
    log: list[object] = []
    made, ref = start(Mission, log=log)
    feed(made, ref, A(), B(), Num(1))
    assert log == ["execute", "closed", ("interrupt", 1), "exit"]


def test_a_handler_that_interrupts_an_entry_cannot_stay() -> None:
    made, ref = start(Mission)
    feed(made, ref, A())
    made.post(ref, Num(0))
    with pytest.raises(HandlerError, match=r"must return Goto, Raise or Halt.*Mission\.Executing\.interrupt\(Num\)"):
        made.run()


class Busy(Logger):
    S = State(start=True, defer=(D,))
    T = State()

    @S.on(A)
    async def _work(self) -> None:
        self.log.append("work")
        self.log.append(await self.receive(B))

    @S.on(B)
    def _b(self) -> None:
        self.log.append("b")

    @S.interrupt(Num)
    async def _first(self, e: Num) -> Next:
        self.log.append(e.n)
        if e.n == 2:
            self.log.append(await self.receive(C))
        if e.n == 4:
            return Raise(D())
        return Halt() if e.n == 3 else Stay()

    @S.exit
    async def _exit(self) -> None:
        self.log.append(("exit", await self.receive(C)))

    S.interrupt(Halt, goto=T)

    @T.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(("T", e.n))

    @T.on(B, C, D)
    def _other(self) -> None:
        pass


def test_interrupts_overtake_the_queue_in_their_own_order() -> None:
    log: list[object] = []
    made, ref = start(Busy, log=log)
    feed(made, ref, B(), Num(1), B(), Num(0))
    assert log == [1, 0, "b", "b"]


def test_after_a_handler_that_was_no_entry_the_machine_may_stay() -> None:
    log: list[object] = []
    made, ref = start(Busy, log=log)
    feed(made, ref, A())
    feed(made, ref, Num(1), B())
    assert log == ["work", 1, "b"]


def test_an_interrupt_handler_is_not_interrupted() -> None:
    log: list[object] = []
    made, ref = start(Busy, log=log)
    feed(made, ref, Num(2))
    feed(made, ref, Num(1))
    assert log == [2]
    feed(made, ref, C())
    assert log == [2, C(), 1]


def test_an_exit_handler_is_not_interrupted() -> None:
    log: list[object] = []
    made, ref = start(Busy, log=log)
    feed(made, ref, Halt())
    feed(made, ref, Num(1))
    assert log == []
    feed(made, ref, C())
    assert log == [("exit", C()), ("T", 1)]
    assert made.state(ref) == "T"


def test_a_returned_halt_is_raised_and_may_be_listed_as_an_interrupt() -> None:
    log: list[object] = []
    made, ref = start(Busy, log=log)
    feed(made, ref, Num(3), C())
    assert log == [3, ("exit", C())]
    assert made.state(ref) == "T"


class Entry(Logger):
    S = State(start=True)

    @S.entry
    async def _enter(self) -> None:
        self.log.append("enter")
        await self.receive(B)

    @S.interrupt(Num)
    def _interrupt(self, e: Num) -> Next:
        return Raise(A()) if e.n == 1 else Halt() if e.n == 2 else Goto(self.S)

    @S.on(A)
    def _a(self) -> None:
        self.log.append("a")


@pytest.mark.parametrize(
    ("n", "log", "state"),
    [(0, ["enter", "enter"], "S"), (1, ["enter", "a"], "S"), (2, ["enter"], None)],
)
def test_after_an_entry_it_may_go_raise_or_halt(n: int, log: list[object], state: str | None) -> None:
    noted: list[object] = []
    made, ref = start(Entry, log=noted)
    feed(made, ref, Num(n))
    assert noted == log
    assert made.state(ref) == state


def test_an_interrupt_that_is_waiting_when_the_entry_starts_comes_at_its_first_await() -> None:
    made = runtime()
    log: list[object] = []
    ref = made.create(Entry, log=log)
    feed(made, ref, A(), Num(1))
    assert log == ["enter", "a", "a"]


class Stubborn(Logger):
    S = State(start=True)

    @S.on(A)
    async def _awaits(self) -> None:
        try:
            await self.receive(B)
        finally:
            await self.receive(C)

    @S.on(B)
    async def _raises(self) -> None:
        try:
            await self.receive(B)
        finally:
            self.log.append(1 / 0)

    @S.on(C)
    async def _swallows(self) -> None:
        try:
            await self.receive(B)
        except GeneratorExit:
            self.log.append("swallowed")

    @S.on(D)
    async def _impossible(self) -> None:
        await self.receive(Num)

    @S.interrupt(Num)
    def _interrupt(self) -> None:
        self.log.append("interrupt")


def test_an_abandoned_handler_may_not_await() -> None:
    made, ref = start(Stubborn)
    feed(made, ref, A())
    made.post(ref, Num(1))
    with pytest.raises(HandlerError, match=r"awaits in a finally.*abandoned.*Stubborn\.S\.on\(A\) \(_awaits\)"):
        made.run()


def test_an_abandoned_handler_that_raises_has_failed() -> None:
    made, ref = start(Stubborn)
    feed(made, ref, B())
    made.post(ref, Num(1))
    with pytest.raises(HandlerError, match=r"while being abandoned, raised ZeroDivisionError.*\(_raises\)"):
        made.run()


def test_an_abandoned_handler_that_ends_without_a_fuss_is_fine() -> None:
    log: list[object] = []
    made, ref = start(Stubborn, log=log)
    feed(made, ref, C())
    feed(made, ref, Num(1))
    assert log == ["swallowed", "interrupt"]


def test_receiving_what_the_state_interrupts_with_is_an_error() -> None:
    made, ref = start(Stubborn)
    made.post(ref, D())
    with pytest.raises(HandlerError, match="receives Num, which this state takes as an interrupt: it can never come"):
        made.run()
