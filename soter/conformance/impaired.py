"""A bad link, for tests: a relay that impairs the messages that it passes on, whatever carries them."""

from __future__ import annotations

import heapq
import random
import threading
import time
from collections.abc import Callable, Iterable
from itertools import count
from typing import Final


class Line:
    """One kind of message of one robot, in one direction; sends from any thread."""

    def __init__(self, robot_id: int, send: Callable[[bytes], object]) -> None:
        self.robot_id: Final = robot_id
        self.send: Final = send
        self.held: bytes | None = None


class ImpairedRelay:
    """Passes messages on, and delays, loses, repeats and swaps them, without looking into them.

    Attributes:
        delay_s: delay of every message.
        loss: share of the messages that is lost.
        duplicate: share that is delivered twice.
        reorder: share that is delivered after its successor.
        garble: share that is followed by bytes that make no sense.
        cut: robots whose messages are all lost.
    """

    def __init__(self) -> None:
        self.delay_s = self.loss = self.duplicate = self.reorder = self.garble = 0.0
        self.cut: frozenset[int] = frozenset()
        self._random: Final = random.Random(0)
        self._due: Final[list[tuple[float, int, Line, bytes]]] = []
        self._numbers: Final = count()
        self._changed: Final = threading.Condition()
        self._done = False
        self._thread: Final = threading.Thread(target=self._deliver, name="relay", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread. Idempotent."""
        with self._changed:
            self._done = True
            self._changed.notify()
        self._thread.join()

    def pass_on(self, line: Line, message: bytes) -> None:
        """Deliver a message, impaired as configured. Messages of one line come from one thread at a time."""
        chance = self._random.random
        if line.robot_id in self.cut or chance() < self.loss:
            return
        messages = [message] * (2 if chance() < self.duplicate else 1)
        if chance() < self.garble:
            # Another program's, one that was cut off, none at all, or one that its checksum shows to be damaged.
            noise, cut_off = self._random.randbytes(len(message)), message[: len(message) // 2]
            messages.append(self._random.choice((noise, cut_off, b"", *self.damaged(message))))
        if chance() < self.reorder and line.held is None:
            line.held = message
            return
        if line.held is not None:
            messages.append(line.held)
            line.held = None
        self._send(line, messages)

    def damaged(self, message: bytes) -> tuple[bytes, ...]:
        """Return a message as it is when it was damaged on the way; nothing where messages carry no checksum."""
        return ()

    def say(self, line: Line, message: bytes, times: int = 1, every_s: float = 0.0, *, after_s: float = 0.0) -> None:
        """Deliver a message that nobody has sent, unimpaired, so many times, the first after a time; return at once."""
        now_s = time.monotonic() + after_s
        with self._changed:
            for number in range(times):
                heapq.heappush(self._due, (now_s + number * every_s, next(self._numbers), line, message))
            self._changed.notify()

    def _send(self, line: Line, messages: Iterable[bytes]) -> None:
        at_s = time.monotonic() + self.delay_s
        with self._changed:
            for message in messages:
                heapq.heappush(self._due, (at_s, next(self._numbers), line, message))
            self._changed.notify()

    def _deliver(self) -> None:
        with self._changed:
            while not self._done:
                left_s = self._due[0][0] - time.monotonic() if self._due else None
                if left_s is None or left_s > 0.0:
                    self._changed.wait(left_s)
                    continue
                _, _, line, message = heapq.heappop(self._due)
                line.send(message)
