from __future__ import annotations

import pickle
import threading
from typing import Any

import pytest

from soter.machine import (
    Goto,
    HandlerError,
    Machine,
    MachineError,
    MachineRef,
    MisuseError,
    Next,
    Runtime,
    State,
)
from tests.machine.helpers import A, B, C, D, Logger, Num, To, feed, runtime, start


class Failing(Logger):
    S = State(start=True)

    @S.on(A)
    def _a(self) -> None:
        raise RuntimeError("broken")

    @S.on(B)
    async def _b(self) -> None:
        await self.receive(C)
        raise KeyError("later")

    @S.on(To)
    def _to(self, e: To) -> None:
        self.send(e.ref, Num(1))
        raise RuntimeError("after a send")

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(e.n)


def test_an_exception_is_wrapped_with_the_place() -> None:
    made, ref = start(Failing, name="failing")
    made.post(ref, A())
    with pytest.raises(HandlerError) as caught:
        made.run()
    error = caught.value
    assert isinstance(error, MachineError)
    assert (error.machine, error.state, error.handler) == ("failing", "S", "Failing.S.on(A) (_a)")
    assert error.event == A()
    assert isinstance(error.__cause__, RuntimeError)
    assert str(error) == ("RuntimeError: broken [machine failing, state S, handler Failing.S.on(A) (_a), event A()]")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # noqa: S301
    assert made.state(ref) is None
    assert made.run() == 0


def test_a_long_event_is_shortened_in_the_message() -> None:
    error = HandlerError("x", machine="m", state="s", handler=None, event=Num(10**300))
    assert len(str(error)) < 300
    assert str(error).endswith("...]")


def test_an_exception_after_a_receive_is_too() -> None:
    made, ref = start(Failing)
    feed(made, ref, B())
    made.post(ref, C())
    with pytest.raises(HandlerError, match=r"KeyError: 'later'.*on\(B\) \(_b\), event C\(\)"):
        made.run()


@pytest.mark.parametrize("pick", [None, lambda n: 0])
def test_an_application_can_isolate_the_machine_that_failed(pick: Any) -> None:
    failures: list[MachineError] = []
    log: list[object] = []
    made = runtime(on_failure=failures.append, pick=pick)
    bad, good = made.create(Failing), made.create(Failing, log=log)
    for event in (A(), Num(1)):
        made.post(bad, event)
        made.post(good, Num(7))
    made.run()
    assert [failure.machine for failure in failures] == ["Failing-1"]
    assert made.state(bad) is None
    assert log == [7, 7]
    feed(made, made.create(Failing), To(good), D())
    assert log == [7, 7, 1]
    assert [type(failure) for failure in failures] == [HandlerError, HandlerError]


def test_run_can_be_called_again_after_a_failure() -> None:
    log: list[object] = []
    made, bad = start(Failing)
    good = made.create(Failing, log=log)
    made.run()
    made.post(bad, A())
    made.post(good, Num(1))
    with pytest.raises(HandlerError):
        made.run()
    made.run()
    assert log == [1]


def test_what_the_policy_raises_leaves_run() -> None:
    class Stop(Exception):
        pass

    def stop(error: MachineError) -> None:
        raise Stop from error

    made = runtime(on_failure=stop)
    ref = made.create(Failing)
    made.post(ref, A())
    with pytest.raises(Stop):
        made.run()


def test_the_policy_may_replace_the_machine() -> None:
    log: list[object] = []
    made = runtime(on_failure=lambda error: replace())

    def replace() -> None:
        made.post(made.create(Failing, log=log), Num(5))

    ref = made.create(Failing)
    feed(made, ref, A())
    assert log == [5]


class Interrupted(Logger):
    S = State(start=True)

    @S.on(A)
    def _a(self) -> None:
        raise KeyboardInterrupt

    @S.on(B)
    async def _b(self) -> None:
        raise KeyboardInterrupt

    @S.on(Num)
    def _num(self, e: Num) -> None:
        self.log.append(e.n)


def test_ctrl_c_leaves_the_runtime_usable() -> None:
    log: list[object] = []
    made, ref = start(Interrupted, log=log)
    for event in (A(), Num(1), B(), Num(2)):
        made.post(ref, event)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            made.run()
        assert made.current_handler is None
    made.run()
    assert log == [1, 2]
    made.close()


class Looker(Logger):
    S = State(start=True)
    T = State()

    @S.on(A)
    async def _a(self) -> Next:
        made: Runtime = self.log[0]
        self.log.append(made.current_handler)
        await self.receive(B)
        self.log.append(made.current_handler)
        return Goto(self.T)

    @T.entry
    def _enter(self) -> None:
        self.log.append(self.log[0].current_handler)

    @T.on(C)
    def _run(self) -> None:
        self.log[0].run()


def test_the_running_handler_can_be_named() -> None:
    made = runtime()
    log: list[Any] = [made]
    ref = made.create(Looker, log=log, name="looker")
    feed(made, ref, A())
    assert made.current_handler is None
    feed(made, ref, B())
    assert log[1:] == ["looker: Looker.S.on(A) (_a)"] * 2 + ["looker: Looker.T.entry (_enter)"]
    made.post(ref, C())
    with pytest.raises(HandlerError, match=r"run\(\) was called while it is running"):
        made.run()


class Blocking(Machine):
    S = State(start=True)

    def __init__(self, entered: threading.Event, leave: threading.Event) -> None:
        self.entered, self.leave = entered, leave

    @S.entry
    def _block(self) -> None:
        self.entered.set()
        assert self.leave.wait(10.0)


def test_another_thread_can_see_who_blocks() -> None:
    entered, leave = threading.Event(), threading.Event()
    made = runtime()
    made.create(Blocking, name="robot", entered=entered, leave=leave)
    seen: list[str | None] = []

    def watch() -> None:
        entered.wait(10.0)
        seen.append(made.current_handler)
        leave.set()

    thread = threading.Thread(target=watch)
    thread.start()
    made.run()
    thread.join()
    assert seen == ["robot: Blocking.S.entry (_block)"]


def test_post_may_be_called_by_any_thread_and_wakes_the_main_loop() -> None:
    woken = threading.Semaphore(0)
    made = runtime(wake=woken.release)
    log: list[object] = []
    ref = made.create(Failing, log=log)
    made.run()

    def post(base: int) -> None:
        for n in range(100):
            made.post(ref, Num(base + n))

    threads = [threading.Thread(target=post, args=(base,)) for base in (0, 1000, 2000)]
    for thread in threads:
        thread.start()
    for _ in range(300):
        assert woken.acquire(timeout=10.0)
        made.run()
    for thread in threads:
        thread.join()
    for base in (0, 1000, 2000):
        assert [n for n in log if isinstance(n, int) and base <= n < base + 1000] == list(range(base, base + 100))


class Silent(Machine):
    S = State(start=True, ignore=(A,))

    def __init__(self, shelf: list[Machine]) -> None:
        shelf.append(self)


def test_machines_act_only_in_their_handlers() -> None:
    shelf: list[Machine] = []
    made, ref = start(Silent, shelf=shelf)
    machine = shelf[0]
    assert machine.ref == ref
    assert machine.now() == 0.0
    for act in (
        lambda: machine.send(ref, A()),
        lambda: machine.announce(A()),
        lambda: machine.create(Failing),
        lambda: machine.after(1.0, A()),
        lambda: machine.choose(2),
    ):
        with pytest.raises(MisuseError, match=r"of Silent-1 was called while none of its handlers runs"):
            act()
    del made


def test_a_machine_that_was_called_into_being_belongs_to_no_runtime() -> None:
    machine = Failing()
    with pytest.raises(MisuseError, match=r"this Failing belongs to no runtime: make it with create\(\)"):
        machine.send(MachineRef(1, "x"), A())
    with pytest.raises(MisuseError, match="belongs to no runtime"):
        _ = machine.ref


class WithPayload(Logger):
    S: State[int] = State(start=True)

    @S.entry
    def _enter(self, n: int) -> None:
        self.log.append(n)


def test_the_payload_of_create_goes_to_the_start_state() -> None:
    log: list[object] = []
    made = runtime()
    made.create(WithPayload, 7, log=log)
    made.run()
    assert log == [7]
    with pytest.raises(MisuseError, match=r"WithPayload\.S\.entry \(_enter\) takes a payload: create"):
        made.create(WithPayload)
    with pytest.raises(MisuseError, match=r"the entry handler of Failing\.S takes no payload"):
        made.create(Failing, 7)


class Teller(Logger):
    S = State(start=True)

    @S.on(To)
    def _to(self, e: To) -> None:
        self.send(e.ref, A())

    @S.on(A)
    def _a(self) -> None:
        self.send("x", A())  # type: ignore[arg-type]


def test_events_need_a_target() -> None:
    made, ref = start(Teller)
    with pytest.raises(MisuseError, match="there is no machine"):
        made.post(MachineRef(99, "x"), A())
    with pytest.raises(MisuseError, match="lives in runtime 'mars', to which this one has no link"):
        made.call_at(0.0, MachineRef(1, "x", "mars"), A())
    made.post(ref, A())
    with pytest.raises(HandlerError, match="MisuseError: events are sent to a MachineRef, not to 'x'"):
        made.run()


@pytest.mark.parametrize("pick", [None, lambda n: 0])
def test_events_for_other_runtimes_are_forwarded(pick: Any) -> None:
    sent: list[object] = []
    made = runtime(forward=lambda ref, event: sent.append((ref.name, event)), pick=pick)
    ref = made.create(Teller)
    there = MachineRef(1, "there", "mars")
    made.post(there, B())
    feed(made, ref, To(there))
    assert sent == [("there", B()), ("there", A())]
    with pytest.raises(MisuseError, match="its state is not known here"):
        made.state(there)


def test_a_run_with_nothing_to_do_does_not_reach_the_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    made, ref = start(Failing)
    made.call_at(1.0, ref, A())
    monkeypatch.delattr("soter.machine.core.Core.run")
    assert made.run() == 0
