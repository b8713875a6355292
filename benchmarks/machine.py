"""What one event costs in the machine runtime: sent, queued, handled; against a bare queue and a table of handlers.

Two machines send each other an event and back, over and over.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from benchmarks.common import Row, arguments, in_turns, show
from soter.machine import Event, Machine, MachineRef, Runtime, State


@dataclass(frozen=True, slots=True)
class Ball(Event):
    """What is sent to and fro; its number goes up each time."""

    number: int


@dataclass(frozen=True, slots=True)
class Partner(Event):
    """Tells a player whom to play with; `serve` starts the game."""

    other: MachineRef
    serve: bool


class Player(Machine):
    """Returns every ball."""

    Idle = State(start=True)
    Playing = State()

    @Idle.on(Partner, goto=Playing)
    def _meet(self, e: Partner) -> None:
        self.other = e.other
        if e.serve:
            self.send(e.other, Ball(0))

    @Playing.on(Ball)
    def _return(self, e: Ball) -> None:
        self.send(self.other, Ball(e.number + 1))


class PlainPlayer:
    """The same without a runtime: a queue for all and a table of handlers each."""

    def __init__(self, queue: deque[tuple[PlainPlayer, Event]]) -> None:
        self._queue = queue
        self.other = self
        self.handlers: dict[type[Event], Callable[[Ball], None]] = {Ball: self._return}

    def _return(self, e: Ball) -> None:
        self._queue.append((self.other, Ball(e.number + 1)))


def runtime_s(events: int) -> float:
    """Return the host time that so many events take in a runtime."""
    runtime = Runtime(now=lambda: 0.0)
    first, second = runtime.create(Player), runtime.create(Player)
    runtime.post(second, Partner(first, False))
    runtime.post(first, Partner(second, True))
    runtime.run(max_steps=100)
    start_s = time.perf_counter()
    done = runtime.run(max_steps=events)
    wall_s = time.perf_counter() - start_s
    if done != events:
        raise RuntimeError(f"the runtime took {done} steps, not {events}")
    runtime.close()
    return wall_s


def plain_s(events: int) -> float:
    """Return the host time that so many events take in a bare loop."""
    queue: deque[tuple[PlainPlayer, Event]] = deque()
    first, second = PlainPlayer(queue), PlainPlayer(queue)
    first.other, second.other = second, first
    queue.append((second, Ball(0)))
    start_s = time.perf_counter()
    for _ in range(events):
        player, event = queue.popleft()
        handle: Callable[..., None] = player.handlers[type(event)]
        handle(event)
    return time.perf_counter() - start_s


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the ratio."""
    quick = arguments(__doc__ or "", argv).quick
    events, rounds = (500, 1) if quick else (100_000, 9)
    times = in_turns({"plain": partial(plain_s, events), "runtime": partial(runtime_s, events)}, rounds)
    plain_us, runtime_us = (min(times[side]) / events * 1e6 for side in ("plain", "runtime"))
    rows = [
        Row("queue and table of handlers", f"{plain_us:.2f} us/event"),
        Row("machine runtime", f"{runtime_us:.2f} us/event", runtime_us / plain_us),
    ]
    show("One event", rows, f"{events} events between two machines; least of {rounds} rounds.")
    return runtime_us / plain_us


if __name__ == "__main__":
    main()
