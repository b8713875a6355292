"""The scheduler: decides which machine takes the next step, and passes events between machines."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from soter.machine.audience import Audience, Transition
from soter.machine.context import MachineContext, SpecContext
from soter.machine.errors import MachineError, MisuseError
from soter.machine.events import Event, MachineRef, check_event
from soter.machine.intake import NOTHING, TimerQueue
from soter.machine.machines import Machine
from soter.machine.states import NO_PAYLOAD, State
from soter.machine.tables import DEFER, LAST_TAKEN, ClassTable, StateTable

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.machine.intake import Timer


class Core:
    """Everything between machines: the events they send, the choice of the next machine, timers.

    Without `pick` a step is one event handled to the end of its handler, or to its next `receive`, and what a
    handler sends is queued at once; machines take turns. With `pick` a step ends at every scheduling point,
    and `pick` decides which machine does the next one. A handler is a plain function and cannot be stopped at
    a send. It need not: what it does besides sending is its machine's own business, so running it ahead and
    letting its sends and creates follow one by one, each in its own step, produces the same interleavings.
    """

    def __init__(
        self,
        now: Callable[[], float],
        pick: Callable[[int], int] | None,
        on_failure: Callable[[MachineError], None] | None,
        node: str,
        forward: Callable[[MachineRef, Event], None] | None,
        temperature_limit: int | None,
    ) -> None:
        self.now = now
        self.pick = pick
        self.on_failure = on_failure
        self.node = node
        self.forward = forward
        self.temperature_limit = temperature_limit
        self.audience = Audience(self)
        self.contexts: dict[int, MachineContext] = {}
        self.ready: deque[MachineContext] = deque()
        self.idled: list[MachineContext] = []
        self.posted: deque[tuple[MachineRef, Event]] = deque()
        self.timers = TimerQueue()
        self.current: MachineContext | None = None
        self.running = False
        self.choosing = False
        self.steps = 0
        self.next_id = 1
        # Posted events and those of timers take part in the scheduling like a machine.
        nowhere = StateTable("outside", State())
        outside = ClassTable("outside", nowhere, {}, {})
        self.outside = self._prepare(MachineContext(self, MachineRef(0, "outside", node), outside, nowhere))
        self.outside.pending = NOTHING

    # Machines come and go

    def make(self, machine: Any, payload: object, name: str | None, kwargs: dict[str, Any]) -> MachineContext:
        """Make a machine that does not run yet."""
        if not (isinstance(machine, type) and issubclass(machine, Machine)):
            raise MisuseError(f"create() takes a machine class, not {machine!r}")
        table = machine.__table__
        if table.start is None:
            raise MisuseError(f"{table.name} has no start state; create a subclass that has one")
        entry = table.start.entry
        if payload is NO_PAYLOAD:
            if entry is not None and entry.takes and not entry.optional:
                raise MisuseError(f"{entry.where} takes a payload: create({table.name}, payload)")
        elif entry is None or not entry.takes:
            raise MisuseError(f"the entry handler of {table.name}.{table.start.name} takes no payload")
        ref = self.new_ref(table.name, name)
        context = self._prepare(MachineContext(self, ref, table, table.start))
        context.pending_event = payload
        # The machine must know its reference before its constructor runs.
        context.machine = machine.__new__(machine)
        context.machine._context = context
        context.machine.__init__(**kwargs)
        return context

    def new_ref(self, kind: str, name: str | None) -> MachineRef:
        """Return the next reference."""
        number = self.next_id
        self.next_id += 1
        return MachineRef(number, f"{kind}-{number}" if name is None else name, self.node)

    def _prepare(self, context: MachineContext) -> MachineContext:
        if self.pick is not None:
            context.outbox = deque()
        return context

    def create_from(
        self, context: MachineContext, machine: type[Machine], payload: object, name: str | None, kwargs: dict[str, Any]
    ) -> MachineRef:
        """Create a machine for a handler."""
        made = self.make(machine, payload, name, kwargs)
        self.contexts[made.ref.id] = made
        if context.outbox is None:
            self.wake(made)
        else:
            made.ready = True  # not in the list yet, but its queue takes events
            context.outbox.append((made, None))
        return made.ref

    def wake(self, context: MachineContext) -> None:
        """Put a machine that can do something into the list."""
        context.ready = True
        self.ready.append(context)

    def halt(self, context: MachineContext) -> None:
        """Stop a machine once everything it has sent has been queued."""
        context.pending = NOTHING
        context.halting = True
        if not context.outbox:
            self._stop(context)

    def _stop(self, context: MachineContext) -> None:
        if context.halted:
            return
        context.halted = True
        context.ready = False
        context.queue.clear()
        self.contexts.pop(context.ref.id, None)
        if isinstance(context, SpecContext):
            self.audience.detach(context)
        if self.audience.observers:
            self.audience.note(Transition(self.now(), context.ref, context.state.name, context.event, None))

    def entered(self, context: MachineContext, source: StateTable | None, target: StateTable) -> None:
        """Tell specs and observers that a machine has changed its state."""
        if context.__class__ is SpecContext:
            context.enter(target, self.steps)
        if self.audience.observers:
            name = None if source is None else source.name
            self.audience.note(Transition(self.now(), context.ref, name, context.event, target.name))

    def idling(self, context: MachineContext) -> None:
        """Note that an idle handler runs: in a live runtime it must not keep `run` from ending."""
        if self.pick is None:
            context.idled = True
            self.idled.append(context)

    # Events on their way

    def send(self, context: MachineContext, to: MachineRef, event: Event) -> None:
        """Send an event for a handler, or for the outside."""
        check_event(event)
        if to.__class__ is not MachineRef or to.id not in self.contexts or to.node != self.node:
            self.check_target(to)
        outbox = context.outbox
        if outbox is None:
            if self.audience.specs:
                self.audience.tell(event)
            self.deliver(to, event)
        else:
            if not outbox:
                self.audience.tell(event)
                context.told = True
            outbox.append((to, event))

    def announce(self, context: MachineContext, event: Event) -> None:
        """Show the specs an event that is not sent to any machine."""
        check_event(event)
        if context.outbox:
            context.outbox.append((None, event))
        else:
            self.audience.tell(event)

    def check_target(self, to: object) -> None:
        """Raise MisuseError unless events can be sent there; a halted machine is allowed."""
        if not isinstance(to, MachineRef):
            raise MisuseError(f"events are sent to a MachineRef, not to {to!r}")
        if to.node != self.node:
            if self.forward is None:
                raise MisuseError(f"{to} lives in runtime {to.node!r}, to which this one has no link")
        elif to.id in self.audience.spec_ids:
            raise MisuseError(f"{to} is a spec; it watches events and cannot be sent any")
        elif not 0 < to.id < self.next_id:
            raise MisuseError(f"there is no machine {to!r} in this runtime")

    def deliver(self, to: MachineRef, event: Event) -> None:
        """Put an event into a machine's queue."""
        if to.node != self.node:
            assert self.forward is not None
            self.forward(to, event)
            return
        context = self.contexts.get(to.id)
        if context is None or context.halting:
            return
        if context.ready:
            context.queue.append(event)
        elif context.waiting is None:
            state = context.state
            kind = (state.actions.get(event.__class__) or state.action(event.__class__)).kind
            if kind <= LAST_TAKEN:
                context.queue.append(event)
                context.ready = True
                self.ready.append(context)
            elif kind == DEFER:
                context.queue.append(event)
        else:
            context.queue.append(event)
            if context.wakes(event):
                self.wake(context)

    def call_at(self, time_s: float, to: MachineRef, event: Event) -> Timer:
        """Add a timer."""
        check_event(event)
        self.check_target(to)
        return self.timers.add(time_s, to, event)

    def _emit(self, to: MachineRef, event: Event) -> None:
        """Send an event from the outside."""
        self.send(self.outside, to, event)
        if self.outside.outbox and not self.outside.ready:
            self.wake(self.outside)

    def _collect(self) -> None:
        """Send the events that other threads have posted and that timers are due to send."""
        posted = self.posted
        # No more than were posted at the beginning: a flood from a thread must not keep the machines waiting.
        for _ in range(len(posted)):
            self._emit(*posted.popleft())
        if self.timers.heap:
            now_s = self.now()
            while (timer := self.timers.pop_due(now_s)) is not None:
                self._emit(timer.to, timer.event)

    def choose(self, n: int) -> int:
        """Return a number from 0 to n - 1, chosen by `pick`, or 0."""
        if n < 1:
            raise ValueError(f"cannot choose one of {n}")
        if self.pick is None or n == 1:
            return 0
        index = self.pick(n)
        if not 0 <= index < n:
            raise ValueError(f"pick({n}) returned {index!r}; it must be from 0 to {n - 1}")
        return index

    # Steps

    def run(self, max_steps: int | None) -> int:
        """Do steps until nothing can be done now."""
        steps = 0
        ready = self.ready
        posted = self.posted
        heap = self.timers.heap
        pick = self.pick
        for context in self.idled:
            context.idled = False
            if not (context.halted or context.ready) and context.waiting is None and context.state.idle is not None:
                self.wake(context)
        self.idled.clear()
        while max_steps is None or steps < max_steps:
            if self.audience.failures:
                self.report()
            if posted or (heap and heap[0][0] <= self.now()):
                self._collect()
            if not ready:
                break
            context = ready.popleft() if pick is None else self._pick_context()
            self.current = context
            try:
                if pick is not None and context.outbox:
                    self._flush(context)
                elif context.pending != NOTHING:
                    context.perform()
                elif context.take() == NOTHING:
                    context.ready = False
                    continue
                elif pick is None:
                    context.perform()
                steps += 1
                self.steps += 1
                self._settle(context)
            except MachineError as error:
                self._fail(context, error)
            except BaseException:
                # Ctrl-C: leave the runtime usable, so that the program can still stop its robots.
                if not context.halted:
                    self.wake(context)
                raise
            finally:
                self.current = None
            if self.temperature_limit is not None:
                self.audience.check_temperature(self.temperature_limit)
        if self.audience.failures:
            self.report()
        return steps

    def _pick_context(self) -> MachineContext:
        ready = self.ready
        index = 0
        if len(ready) > 1:
            self.choosing = True
            try:
                index = self.choose(len(ready))
            finally:
                self.choosing = False
        context = ready[index]
        del ready[index]
        return context

    def _flush(self, context: MachineContext) -> None:
        """Let the first thing that a handler has sent or created take effect."""
        assert context.outbox is not None
        what, event = context.outbox.popleft()
        context.told = False
        if event is None:
            assert isinstance(what, MachineContext)
            self.wake(what)
        else:
            assert isinstance(what, MachineRef)
            self.deliver(what, event)

    def _settle(self, context: MachineContext) -> None:
        """After a step, go on to the next scheduling point, and see whether the machine has more to do."""
        if context.outbox:
            self._tell_next(context)
        if context.outbox:
            self.ready.append(context)
            return
        if context.halting:
            self._stop(context)
            return
        state = context.state
        if context.pending != NOTHING:
            more = True
        elif context.waiting is not None:
            more = context.take() != NOTHING
        elif self.pick is None:
            # Whether it can take an event is found out when its turn comes.
            more = bool(context.queue) or (state.idle is not None and not context.idled)
        elif state.interrupts or state.idle is not None:
            # The event to take depends on what arrives before the next step, so taking it must be a step of its own.
            more = context.can_take()
        else:
            more = context.take() != NOTHING
        if more:
            self.ready.append(context)
        else:
            context.ready = False

    def _tell_next(self, context: MachineContext) -> None:
        outbox = context.outbox
        while outbox:
            what, event = outbox[0]
            if event is None:
                return
            if not context.told:
                self.audience.tell(event)
                context.told = True
            if what is not None:
                return
            outbox.popleft()
            context.told = False

    # Failures

    def _fail(self, context: MachineContext, error: MachineError) -> None:
        """Halt the machine that failed, and let the application decide whether the others go on."""
        context.abandon(quietly=True)
        self.halt(context)
        if context.outbox:
            self.ready.append(context)
        self.current = None
        self.judge(error)

    def judge(self, error: MachineError) -> None:
        """Pass a failure to the application's `on_failure`; without one, raise it."""
        if self.on_failure is None:
            raise error
        self.on_failure(error)

    def report(self) -> None:
        """Hand over the failures of specs and observers."""
        while self.audience.failures:
            failure = self.audience.failures.popleft()
            if not isinstance(failure, MachineError):
                raise failure
            self.judge(failure)
