"""A channel between two processes over a bus that loses, doubles, delays and reorders: letters once each, in order.

One end a process and peer. Nothing here has a clock, a thread or a bus: frames and the time are handed in and out.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from soter.link.letters import MAX_LETTERS, Frame, Letter

REPEAT_S: Final = 0.2
"""What is not acknowledged is sent again after so long, and so is a question that nobody has answered."""

ALIVE_S: Final = 1.0
"""An end with nothing to say says so this often."""

MAX_WAITING: Final = 1000
"""Letters that may wait to be acknowledged; task planner and robots have a few under way."""


@dataclass(frozen=True, slots=True)
class Came:
    """The other end is there, for the first time or after a new start. Letters to an earlier start are gone."""


class Channel:
    """One end.

    A process that starts anew has a new epoch, and with it all begins anew: numbers, and letters not yet acknowledged
    are dropped, since they were for somebody who is no more. Whoever hears an epoch that it does not know asks it to
    repeat a number first: a frame that was under way for long cannot do that, so that nobody ever turns back to a
    process that has ended.

    Both ends live once: of two processes with one name no letters would arrive in order.

    Args:
        epoch: of this process; above 0.
        mission: what it runs; frames of another mission are ignored.
        draw: returns a number above 0 that was not used before.

    Attributes:
        foreign: the mission of the last frame that was ignored for it; empty while there was none.
    """

    def __init__(self, epoch: int, mission: str, draw: Callable[[], int]) -> None:
        self.foreign = ""
        self._epoch: Final = epoch
        self._mission: Final = mission
        self._draw: Final = draw
        self._peer = 0
        self._candidate = (0, 0)  # an epoch, and what it was asked to repeat
        self._answer = (0, 0)  # an epoch that has asked, and what it wants repeated
        self._waiting: Final[deque[Letter]] = deque()
        self._first = 1  # the number of the first that waits
        self._taken = 0
        self._owes_frame = False
        self._sent_s = -math.inf
        self._asked_s = -math.inf
        self._fresh = False  # something waits that was never sent

    @property
    def there(self) -> bool:
        """Whether the other end has been there, and can be sent letters; it may have ended meanwhile."""
        return self._peer != 0

    def send(self, letter: Letter) -> None:
        """Have a letter delivered to the other end as it lives now; dropped while nobody has come.

        Raises:
            OverflowError: too many wait.
        """
        if not self.there:
            return
        if len(self._waiting) >= MAX_WAITING:
            raise OverflowError(f"{MAX_WAITING} letters wait to be acknowledged")
        self._waiting.append(letter)
        self._fresh = True

    def take(self, frame: Frame) -> list[Letter | Came]:
        """Take a frame; return what follows from it, in order."""
        if frame.mission != self._mission:
            self.foreign = frame.mission
            return []
        if frame.epoch in (0, self._epoch):
            return []
        came: list[Letter | Came] = []
        mine = frame.to == self._epoch
        if frame.ask and frame.to in (0, self._epoch):
            # Whoever asked before may be long gone; if not, it asks again.
            self._answer = (frame.epoch, frame.ask)
        if frame.epoch != self._peer:
            epoch, asked = self._candidate
            if not (mine and frame.epoch == epoch and frame.answer == asked):
                if frame.epoch != epoch:
                    self._candidate = (frame.epoch, self._draw())
                    self._asked_s = -math.inf
                return []
            self._adopt(frame.epoch)
            came.append(Came())
        if not mine:
            return came
        self._acknowledge(frame.taken)
        for number, letter in enumerate(frame.letters, start=frame.first):
            self._owes_frame = True
            if number == self._taken + 1:
                self._taken = number
                came.append(letter)
        return came

    def due(self, now_s: float) -> list[Frame]:
        """Return the frames that are to be sent now; none most of the time."""
        frames = []
        epoch, asked = self._candidate
        if epoch and now_s - self._asked_s >= REPEAT_S:
            self._asked_s = now_s
            frames.append(Frame(self._epoch, epoch, self._mission, asked, self._answered(epoch)))
        asker = self._answer[0]
        if asker not in (0, self._peer):
            frames.append(Frame(self._epoch, asker, self._mission, 0, self._answered(asker)))
        quiet_s = now_s - self._sent_s
        at_once = self._owes_frame or self._fresh or self._answer[0] != 0
        within_s = REPEAT_S if self._waiting or not self.there else ALIVE_S
        if at_once or quiet_s >= within_s:
            self._sent_s = now_s
            self._owes_frame = self._fresh = False
            letters = tuple(self._waiting[index] for index in range(min(len(self._waiting), MAX_LETTERS)))
            answer = self._answered(self._peer)
            frames.append(Frame(self._epoch, self._peer, self._mission, 0, answer, self._taken, self._first, letters))
        return frames

    def _answered(self, epoch: int) -> int:
        """Return what is to be repeated to an epoch, which then is done with; 0 for nothing."""
        asker, asked = self._answer
        if asker != epoch:
            return 0
        self._answer = (0, 0)
        return asked

    def _adopt(self, epoch: int) -> None:
        self._peer = epoch
        self._candidate = (0, 0)
        self._waiting.clear()
        self._first = 1
        self._taken = 0
        self._owes_frame = True
        self._fresh = False

    def _acknowledge(self, taken: int) -> None:
        while self._waiting and self._first <= taken:
            self._waiting.popleft()
            self._first += 1
            # The next ones need not wait until those before them would have been repeated.
            self._fresh = bool(self._waiting)
