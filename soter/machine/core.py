"""The scheduler: which machine does its next step, and what passes between machines."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from soter.machine.audience import Audience, Transition
from soter.machine.cell import Cell, SpecCell
from soter.machine.errors import MachineError, MisuseError
from soter.machine.events import Event, MachineRef, guard_of
from soter.machine.intake import NOTHING, TimerQueue
from soter.machine.machines import Machine
from soter.machine.states import NO_PAYLOAD, State
from soter.machine.tables import DEFER, LAST_TAKEN, ClassTable, StateTable

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.machine.intake import Timer


class Core:
    """Everything that lies between machines: what they send, the choice of who is next, timers.

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
        self.cells: dict[int, Cell] = {}
        self.ready: deque[Cell] = deque()
        self.idled: list[Cell] = []
        self.posted: deque[tuple[MachineRef, Event]] = deque()
        self.timers = TimerQueue()
        self.current: Cell | None = None
        self.running = False
        self.choosing = False
        self.steps = 0
        self.next_id = 1
        # Whoever posts and whatever timers send takes part in the scheduling like a machine.
        nowhere = StateTable("outside", State())
        outside = ClassTable("outside", nowhere, {}, {})
        self.outside = self._prepare(Cell(self, MachineRef(0, "outside", node), outside, nowhere))
        self.outside.pending = NOTHING

    # Machines come and go

    def make(self, machine: Any, payload: object, name: str | None, kwargs: dict[str, Any]) -> Cell:
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
        cell = self._prepare(Cell(self, ref, table, table.start))
        cell.pending_event = payload
        # The machine must know its reference before its constructor runs.
        cell.machine = machine.__new__(machine)
        cell.machine._cell = cell
        cell.machine.__init__(**kwargs)
        return cell

    def new_ref(self, kind: str, name: str | None) -> MachineRef:
        """Return the next reference."""
        number = self.next_id
        self.next_id += 1
        return MachineRef(number, f"{kind}-{number}" if name is None else name, self.node)

    def _prepare(self, cell: Cell) -> Cell:
        if self.pick is not None:
            cell.outbox = deque()
        return cell

    def create_from(
        self, cell: Cell, machine: type[Machine], payload: object, name: str | None, kwargs: dict[str, Any]
    ) -> MachineRef:
        """Create a machine for a handler."""
        made = self.make(machine, payload, name, kwargs)
        self.cells[made.ref.id] = made
        if cell.outbox is None:
            self.wake(made)
        else:
            made.ready = True  # not in the list yet, but its queue takes events
            cell.outbox.append((made, None))
        return made.ref

    def wake(self, cell: Cell) -> None:
        """Put a machine that can do something into the list."""
        cell.ready = True
        self.ready.append(cell)

    def halt(self, cell: Cell) -> None:
        """Stop a machine, once everything it has sent is under way."""
        cell.pending = NOTHING
        cell.halting = True
        if not cell.outbox:
            self._stop(cell)

    def _stop(self, cell: Cell) -> None:
        if cell.halted:
            return
        cell.halted = True
        cell.ready = False
        cell.queue.clear()
        self.cells.pop(cell.ref.id, None)
        if isinstance(cell, SpecCell):
            self.audience.detach(cell)
        if self.audience.observers:
            self.audience.note(Transition(self.now(), cell.ref, cell.state.name, cell.event, None))

    def entered(self, cell: Cell, source: StateTable | None, target: StateTable) -> None:
        """Tell whom it concerns that a machine has changed its state."""
        if cell.__class__ is SpecCell:
            cell.enter(target, self.steps)
        if self.audience.observers:
            name = None if source is None else source.name
            self.audience.note(Transition(self.now(), cell.ref, name, cell.event, target.name))

    def idling(self, cell: Cell) -> None:
        """Note that an idle handler runs: in a live runtime it must not keep `run` from coming to an end."""
        if self.pick is None:
            cell.idled = True
            self.idled.append(cell)

    # Events on their way

    def send(self, cell: Cell, to: MachineRef, event: Event) -> None:
        """Send an event for a handler, or for the outside."""
        guard = guard_of(event.__class__)
        if guard is not None:
            guard(event)
        if to.__class__ is not MachineRef or to.id not in self.cells or to.node != self.node:
            self.check_target(to)
        outbox = cell.outbox
        if outbox is None:
            if self.audience.specs:
                self.audience.tell(event)
            self.deliver(to, event)
        else:
            if not outbox:
                self.audience.tell(event)
                cell.told = True
            outbox.append((to, event))

    def announce(self, cell: Cell, event: Event) -> None:
        """Tell the specs of an event that is sent to nobody."""
        guard = guard_of(event.__class__)
        if guard is not None:
            guard(event)
        if cell.outbox:
            cell.outbox.append((None, event))
        else:
            self.audience.tell(event)

    def check_target(self, to: object) -> None:
        """Raise MisuseError unless events can be sent there. A halted machine is a fine target."""
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
        cell = self.cells.get(to.id)
        if cell is None or cell.halting:
            return
        if cell.ready:
            cell.queue.append(event)
        elif cell.waiting is None:
            state = cell.state
            kind = (state.actions.get(event.__class__) or state.action(event.__class__)).kind
            if kind <= LAST_TAKEN:
                cell.queue.append(event)
                cell.ready = True
                self.ready.append(cell)
            elif kind == DEFER:
                cell.queue.append(event)
        else:
            cell.queue.append(event)
            if cell.wakes(event):
                self.wake(cell)

    def call_at(self, time_s: float, to: MachineRef, event: Event) -> Timer:
        """Add a timer."""
        guard = guard_of(event.__class__)
        if guard is not None:
            guard(event)
        self.check_target(to)
        return self.timers.add(time_s, to, event)

    def _emit(self, to: MachineRef, event: Event) -> None:
        """Send an event from the outside."""
        self.send(self.outside, to, event)
        if self.outside.outbox and not self.outside.ready:
            self.wake(self.outside)

    def _collect(self) -> None:
        """Take in what other threads have posted and what timers have to send."""
        posted = self.posted
        # No more than was there at the beginning: a thread that floods must not keep the machines waiting.
        for _ in range(len(posted)):
            self._emit(*posted.popleft())
        if self.timers.heap:
            now_s = self.now()
            while (timer := self.timers.pop_due(now_s)) is not None:
                self._emit(timer.to, timer.event)

    def choose(self, n: int) -> int:
        """Make a choice that is left open."""
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
        for cell in self.idled:
            cell.idled = False
            if not (cell.halted or cell.ready) and cell.waiting is None and cell.state.idle is not None:
                self.wake(cell)
        self.idled.clear()
        while max_steps is None or steps < max_steps:
            if self.audience.failures:
                self.report()
            if posted or (heap and heap[0][0] <= self.now()):
                self._collect()
            if not ready:
                break
            cell = ready.popleft() if pick is None else self._pick_cell()
            self.current = cell
            try:
                if pick is not None and cell.outbox:
                    self._flush(cell)
                elif cell.pending != NOTHING:
                    cell.perform()
                elif cell.take() == NOTHING:
                    cell.ready = False
                    continue
                elif pick is None:
                    cell.perform()
                steps += 1
                self.steps += 1
                self._settle(cell)
            except MachineError as error:
                self._fail(cell, error)
            except BaseException:
                # Ctrl-C: leave the runtime usable, so that the program can still stop its robots.
                if not cell.halted:
                    self.wake(cell)
                raise
            finally:
                self.current = None
            if self.temperature_limit is not None:
                self.audience.check_temperature(self.temperature_limit)
        if self.audience.failures:
            self.report()
        return steps

    def _pick_cell(self) -> Cell:
        ready = self.ready
        index = 0
        if len(ready) > 1:
            self.choosing = True
            try:
                index = self.choose(len(ready))
            finally:
                self.choosing = False
        cell = ready[index]
        del ready[index]
        return cell

    def _flush(self, cell: Cell) -> None:
        """Let the first thing that a handler has sent or created take effect."""
        assert cell.outbox is not None
        what, event = cell.outbox.popleft()
        cell.told = False
        if event is None:
            assert isinstance(what, Cell)
            self.wake(what)
        else:
            assert isinstance(what, MachineRef)
            self.deliver(what, event)

    def _settle(self, cell: Cell) -> None:
        """After a step, go on to the next scheduling point, and see whether the machine has more to do."""
        if cell.outbox:
            self._tell_next(cell)
        if cell.outbox:
            self.ready.append(cell)
            return
        if cell.halting:
            self._stop(cell)
            return
        state = cell.state
        if cell.pending != NOTHING:
            more = True
        elif cell.waiting is not None:
            more = cell.take() != NOTHING
        elif self.pick is None:
            # Whether it can take any of it is found out when its turn comes.
            more = bool(cell.queue) or (state.idle is not None and not cell.idled)
        elif state.interrupts or state.idle is not None:
            # What is taken here depends on what arrives before the next step, so it must be a step of its own.
            more = cell.can_take()
        else:
            more = cell.take() != NOTHING
        if more:
            self.ready.append(cell)
        else:
            cell.ready = False

    def _tell_next(self, cell: Cell) -> None:
        outbox = cell.outbox
        while outbox:
            what, event = outbox[0]
            if event is None:
                return
            if not cell.told:
                self.audience.tell(event)
                cell.told = True
            if what is not None:
                return
            outbox.popleft()
            cell.told = False

    # Failures

    def _fail(self, cell: Cell, error: MachineError) -> None:
        """Halt the machine that failed, and let the application decide about the rest."""
        cell.abandon(quietly=True)
        self.halt(cell)
        if cell.outbox:
            self.ready.append(cell)
        self.current = None
        self.judge(error)

    def judge(self, error: MachineError) -> None:
        """Hand a failure to the application; without one that takes it, raise it."""
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
