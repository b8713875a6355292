"""The runtime: creates machines, runs them, and connects them with time and with other threads."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.errors import SoterError
from soter.machine.audience import Transition
from soter.machine.context import SpecContext
from soter.machine.core import Core
from soter.machine.errors import LivenessError, MachineError, MisuseError
from soter.machine.events import Event, Halt, MachineRef, check_event
from soter.machine.states import NO_PAYLOAD

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.machine.intake import Timer
    from soter.machine.machines import Machine, Spec


class Blocked(NamedTuple):
    """A machine that waits in `receive` for events of some classes."""

    machine: MachineRef
    state: str
    handler: str
    events: tuple[type[Event], ...]


class SpecStatus(NamedTuple):
    """The status of a spec.

    Attributes:
        spec: Which spec.
        state: The state it is in.
        hot: Whether that state is hot.
        temperature: For how many steps it has been hot since it was last cold.
    """

    spec: MachineRef
    state: str
    hot: bool
    temperature: int


class Runtime:
    """Runs machines, one step at a time and always in the same order.

    Everything but `post`, `steps` and `current_handler` belongs to one thread.

    Args:
        now: The clock in seconds; timers and records use it. By default the host's monotonic clock.
        pick: Decides every choice: ``pick(n)``, asked when n >= 2, returns 0 to n - 1. It makes steps as
            small as a systematic tester needs. Without it machines take turns in a fixed order, which is one
            of the orders that `pick` can choose, and `Machine.choose` takes the first option. Replaying the numbers
            that it returned repeats the run exactly: their list is the run's trace.
        on_failure: Called with every failure of a machine or spec, which has been halted by then. If it
            returns, the others carry on; if it raises, that leaves `run`. Without it the failure itself is
            raised.
        node: Name of this runtime; part of every `MachineRef`.
        forward: Called with events sent to machines of other runtimes.
        wake: Called by `post`, in the thread that posts, so that a sleeping main loop can be woken.
        temperature_limit: A spec that stays hot for more steps than this raises `LivenessError`.
    """

    def __init__(
        self,
        *,
        now: Callable[[], float] = time.monotonic,
        pick: Callable[[int], int] | None = None,
        on_failure: Callable[[MachineError], None] | None = None,
        node: str = "local",
        forward: Callable[[MachineRef, Event], None] | None = None,
        wake: Callable[[], None] | None = None,
        temperature_limit: int | None = None,
    ) -> None:
        self._core = Core(now, pick, on_failure, node, forward, temperature_limit)
        self._wake = wake
        self._closed = False

    # Setting up

    def create(
        self, machine: type[Machine], payload: object = NO_PAYLOAD, *, name: str | None = None, **kwargs: Any
    ) -> MachineRef:
        """Create a machine, which starts in the next `run`; return the reference to send events to.

        Args:
            machine: Its class.
            payload: What the entry handler of its start state is called with.
            name: Its name in messages and recordings; by default the class and a number.
            **kwargs: Passed to the constructor of the class.

        Raises:
            MisuseError: The class has no start state, or its entry handler and the payload do not fit.
        """
        core = self._core
        context = core.make(machine, payload, name, kwargs)
        core.contexts[context.ref.id] = context
        core.wake(context)
        return context.ref

    def monitor(self, spec: type[Spec], *, name: str | None = None, **kwargs: Any) -> MachineRef:
        """Attach a spec and start it at once. It sees every event that it observes from now on.

        Args:
            spec: Its class.
            name: Its name in messages and recordings.
            **kwargs: Passed to the constructor of the class.

        Raises:
            MisuseError: The class has no start state.
            SpecError: The entry handler of its start state failed.
        """
        core = self._core
        table = spec.__table__
        if table.start is None:
            raise MisuseError(f"{table.name} has no start state and cannot be used; use a subclass of it")
        context = SpecContext(core, core.new_ref(table.name, name), table, table.start)
        context.machine = spec(**kwargs)
        core.audience.attach(context)
        return context.ref

    def observe(self, observer: Callable[[Transition], None]) -> Callable[[], None]:
        """Call an observer, which must not call the runtime, with every change of state; return what ends this."""
        self._core.audience.observers.append(observer)

        def stop() -> None:
            if observer in self._core.audience.observers:
                self._core.audience.observers.remove(observer)

        return stop

    # Running

    def post(self, to: MachineRef, event: Event) -> None:
        """Send an event from outside the machines. Any thread may; the event is sent in the next `run`.

        After `close` it does nothing, since threads may still be on their way out.

        Raises:
            EventError: The event is not immutable.
            MisuseError: There is no such machine.
        """
        check_event(event)
        self._core.check_target(to)
        if self._closed:
            return
        self._core.posted.append((to, event))
        if self._wake is not None:
            self._wake()

    def call_at(self, time_s: float, to: MachineRef, event: Event) -> Timer:
        """Send an event when the clock reaches a time, in the first `run` from then on; return its timer.

        Args:
            time_s: Seconds on the runtime's clock; a time in the past is due at once.
            to: The machine.
            event: The event.

        Raises:
            EventError: The event is not immutable.
            MisuseError: There is no such machine.
            ValueError: The time is not finite.
        """
        return self._core.call_at(time_s, to, event)

    def run(self, max_steps: int | None = None) -> int:
        """Do steps, at most `max_steps`, until nothing can be done at the current time; return how many were done.

        Raises:
            MachineError: A machine or spec failed and `on_failure` did not take it. `run` can be called
                again.
            LivenessError: A spec stayed hot for too long.
            MisuseError: Called from inside `run`, or after `close`.
        """
        core = self._core
        if core.running:
            raise MisuseError("run() was called while it is running; it is for the program outside the machines")
        if not (core.ready or core.posted or core.idled or core.audience.failures):
            heap = core.timers.heap
            if not heap or heap[0][0] > core.now():
                return 0
        if self._closed:
            raise MisuseError("run() after close()")
        core.running = True
        try:
            return core.run(max_steps)
        finally:
            core.running = False

    def finish(self) -> None:
        """Check at the end of a run that no spec is in a hot state.

        Raises:
            LivenessError: Specs are in hot states.
        """
        hot = [(spec.ref.name, spec.state.name) for spec in self._core.audience.specs if spec.state.state.hot]
        if hot:
            raise LivenessError("at the end of the run", hot)

    def close(self) -> None:
        """Close all waiting handlers, so that their `finally` blocks run now. Nothing runs afterwards.

        Raises:
            SoterError: A handler awaited or raised while it was being closed; the others are closed all the
                same.
        """
        core = self._core
        if self._closed:
            return
        self._closed = True
        first: SoterError | None = None
        for context in list(core.contexts.values()):
            core.current = context
            try:
                context.abandon()
            except MachineError as error:
                first = first or error
            finally:
                core.current = None
        core.ready.clear()
        core.posted.clear()
        core.idled.clear()
        core.timers.heap.clear()
        if first is not None:
            raise first

    # Looking in

    @property
    def idle(self) -> bool:
        """Whether `run` would do nothing now."""
        core = self._core
        next_s = core.timers.next_s()
        return not (core.ready or core.posted) and (next_s is None or next_s > core.now())

    @property
    def next_timer_s(self) -> float | None:
        """When the next timer is due, in seconds on the runtime's clock; None if there is none."""
        return self._core.timers.next_s()

    @property
    def steps(self) -> int:
        """Steps done since the beginning. Any thread may read it."""
        return self._core.steps

    @property
    def running(self) -> bool:
        """Whether `run` is at work. Any thread may read it."""
        return self._core.running

    @property
    def current_handler(self) -> str | None:
        """The machine and the handler that is running; None between steps. Any thread may read it.

        If a watchdog finds the same handler and the same `steps` for too long, that handler blocks.
        """
        context = self._core.current
        handler = None if context is None else context.handler
        return None if context is None or handler is None else f"{context.ref.name}: {handler.where}"

    @property
    def candidates(self) -> tuple[MachineRef, ...]:
        """While `pick` chooses the next machine: the machines to choose from, in order. Empty for other choices.

        Number 0 stands for the outside: what was posted and what timers send.
        """
        core = self._core
        return tuple(context.ref for context in core.ready) if core.choosing else ()

    def state(self, machine: MachineRef) -> str | None:
        """Return the name of the state a machine or spec is in; None if it has stopped.

        Raises:
            MisuseError: The machine belongs to another runtime.
        """
        core = self._core
        if machine.node != core.node:
            raise MisuseError(f"{machine} lives in runtime {machine.node!r}; its state is not known here")
        context = core.contexts.get(machine.id)
        if context is None:
            context = next((spec for spec in core.audience.specs if spec.ref.id == machine.id), None)
        return None if context is None or context.halting else context.state.name

    def blocked(self) -> list[Blocked]:
        """Return the machines waiting in `receive` if no machine can take a step, else an empty list.

        In a live mission that is normal. If nothing comes from outside and `next_timer_s` is None it is a
        deadlock.
        """
        if not self.idle:
            return []
        found = []
        for context in self._core.contexts.values():
            if context.waiting is not None and context.handler is not None:
                events = tuple(e for e in context.waiting.events[:-1] if e is not Halt)
                found.append(Blocked(context.ref, context.state.name, context.handler.where, events))
        return found

    def specs(self) -> list[SpecStatus]:
        """Return the status of every attached spec."""
        core = self._core
        return [
            SpecStatus(s.ref, s.state.name, s.state.state.hot, s.temperature(core.steps)) for s in core.audience.specs
        ]
