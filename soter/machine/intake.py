"""The rules of a machine's queue: what it takes next."""

from __future__ import annotations

import heapq
import math
from collections import deque
from itertools import count
from typing import TYPE_CHECKING, Any

from soter.errors import account_of
from soter.machine.errors import HandlerError, MachineError
from soter.machine.events import Event, Halt, MachineRef
from soter.machine.states import NO_PAYLOAD
from soter.machine.tables import IGNORE, LAST_INTERRUPTIBLE, LAST_TAKEN, PREEMPT, Handler, StateTable

if TYPE_CHECKING:
    from collections.abc import Callable, Generator


class Timer:
    """An event that will be sent at a time. Used from the runtime's thread only.

    Attributes:
        time_s: When it is due, in seconds on the runtime's clock.
        active: Whether it is still going to be sent; false once it was sent or cancelled.
    """

    __slots__ = ("active", "event", "time_s", "to")

    def __init__(self, time_s: float, to: MachineRef, event: Event) -> None:
        self.time_s = time_s
        self.to = to
        self.event = event
        self.active = True

    def cancel(self) -> bool:
        """Cancel the timer; return whether this kept the event from being sent. A queued event cannot be recalled."""
        was_active, self.active = self.active, False
        return was_active


class TimerQueue:
    """Timers in order of time, and of age for equal times."""

    __slots__ = ("_count", "heap")

    def __init__(self) -> None:
        self.heap: list[tuple[float, int, Timer]] = []
        self._count = count()

    def add(self, time_s: float, to: MachineRef, event: Event) -> Timer:
        """Add a timer.

        Raises:
            ValueError: The time is not a finite number.
        """
        if not math.isfinite(time_s):
            raise ValueError(f"a timer's time must be a finite number of seconds, not {time_s!r}")
        timer = Timer(time_s, to, event)
        heapq.heappush(self.heap, (time_s, next(self._count), timer))
        return timer

    def next_s(self) -> float | None:
        """Return the time of the first active timer, and forget the cancelled ones before it."""
        heap = self.heap
        while heap and not heap[0][2].active:
            heapq.heappop(heap)
        return heap[0][0] if heap else None

    def pop_due(self, now_s: float) -> Timer | None:
        """Return the first active timer that is due, no longer active; None if none is due."""
        next_s = self.next_s()
        if next_s is None or next_s > now_s:
            return None
        timer = heapq.heappop(self.heap)[2]
        timer.active = False
        return timer


# What a machine does in its next step.
NOTHING, START, EVENT, RECEIVED, INTERRUPTED, IDLING = range(6)


class Wait:
    """A blocked `receive`: the only thing that a handler may await."""

    __slots__ = ("context", "events", "explicit_halt", "match", "seen")

    def __init__(self, context: Intake, events: tuple[type[Event], ...], match: Callable[[Any], bool] | None) -> None:
        self.context = context
        self.events = (*events, Halt)
        self.explicit_halt = Halt in events
        self.match = match
        self.seen = 0

    def __await__(self) -> Generator[Wait, Event, Event]:
        return (yield self)

    def wants(self, event: Event) -> bool:
        """Tell whether the event ends the wait. Halt does even if it is not listed."""
        if not isinstance(event, self.events):
            return False
        if self.match is None or (event.__class__ is Halt and not self.explicit_halt):
            return True
        return bool(self.match(event))


class Intake:
    """The queue of a machine, its state, and the event that it takes next."""

    __slots__ = ("event", "handler", "idled", "pending", "pending_event", "queue", "ref", "state", "waiting")

    def __init__(self, ref: MachineRef, start: StateTable) -> None:
        self.ref = ref
        self.state = start
        self.queue: deque[Event] = deque()
        self.waiting: Wait | None = None
        self.handler: Handler | None = None
        self.event: Event | None = None
        self.pending = START
        self.pending_event: Any = NO_PAYLOAD
        self.idled = False  # the idle handler must not run again in this run of the runtime

    def take(self) -> int:
        """Decide on the next step and take its event from the queue; NOTHING if the machine must wait."""
        if self.waiting is not None:
            self.pending = self._take_received()
        else:
            self.pending = self._take_queued()
        return self.pending

    def _take_interrupt(self) -> bool:
        queue = self.queue
        state = self.state
        for index, event in enumerate(queue):
            if state.action(event.__class__).kind == PREEMPT:
                self.pending_event = event
                del queue[index]
                return True
        return False

    def _take_received(self) -> int:
        wait = self.waiting
        handler = self.handler
        assert wait is not None
        assert handler is not None
        if self.state.interrupts and handler.role <= LAST_INTERRUPTIBLE and self._take_interrupt():
            return INTERRUPTED
        queue = self.queue
        for index in range(wait.seen, len(queue)):
            event = queue[index]
            try:
                wanted = wait.wants(event)
            except KeyboardInterrupt:
                raise
            except BaseException as exc:
                raise self.failure(exc, "match raised ") from exc
            if wanted:
                del queue[index]
                self.pending_event = event
                return RECEIVED
        wait.seen = len(queue)
        return NOTHING

    def _take_queued(self) -> int:
        queue = self.queue
        state = self.state
        if queue:
            if state.interrupts and self._take_interrupt():
                return INTERRUPTED
            index = 0
            while index < len(queue):
                event = queue[index]
                action = state.actions.get(event.__class__) or state.action(event.__class__)
                if action.kind <= LAST_TAKEN:
                    if index:
                        del queue[index]
                    else:
                        queue.popleft()
                    self.pending_event = event
                    return EVENT
                if action.kind == IGNORE:
                    del queue[index]
                else:
                    index += 1
        if state.idle is not None and not self.idled:
            return IDLING
        return NOTHING

    def can_take(self) -> bool:
        """Tell whether a resting machine could take something, without taking it."""
        state = self.state
        if state.idle is not None and not self.idled:
            return True
        return any(state.action(event.__class__).kind <= LAST_TAKEN for event in self.queue)

    def wakes(self, event: Event) -> bool:
        """Tell whether an event, just queued, gives a machine that waits in `receive` something to do."""
        wait = self.waiting
        handler = self.handler
        assert wait is not None
        assert handler is not None
        if (
            self.state.interrupts
            and handler.role <= LAST_INTERRUPTIBLE
            and self.state.action(event.__class__).kind == PREEMPT
        ):
            return True
        try:
            wanted = wait.wants(event)
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001 - the receiver's failure, which its own step will raise again
            return True
        if not wanted and wait.seen == len(self.queue) - 1:
            wait.seen += 1
        return wanted

    def failure(self, exc: BaseException, prefix: str = "") -> MachineError:
        """Return the error that reports an exception raised by user code."""
        return self.error(prefix + account_of(exc, lambda each: f"{type(each).__name__}: {each}"))

    def error(self, reason: str, kind: type[MachineError] = HandlerError) -> MachineError:
        """Return an error that names the machine's state, handler and event."""
        where = None if self.handler is None else self.handler.where
        return kind(reason, machine=self.ref.name, state=self.state.name, handler=where, event=self.event)
