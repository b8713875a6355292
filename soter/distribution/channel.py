"""A channel between two processes over a bus that loses, doubles, delays and reorders: messages once each, in order.

Messages are machine events in MessagePack: what a task planner and robot agents elsewhere tell each other. They are
decoded into these types or refused; who sends is named by the key that they came under.

One end a process and peer. Nothing here has a clock, a thread or a bus: frames and the time are handed in and out.
"""

from __future__ import annotations

import logging
import math
import secrets
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Final

import msgspec

from soter.distribution.bus import Bus, BusInbox
from soter.isolation.messages import Id, Text, decoded, encode
from soter.sdk.values import MAX_COORDINATE_M

MAX_FRAME_BYTES: Final = 1 << 14
MAX_MESSAGES: Final = 16
"""Messages in one frame; the rest goes with the next."""

Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]

MAX_REASON: Final = 100
"""Characters; so that a frame of the longest messages is no longer than `MAX_FRAME_BYTES`."""

Reason = Annotated[str, msgspec.Meta(max_length=MAX_REASON)]


class _ReliableMessage(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    pass


class VisitMessage(_ReliableMessage, tag="visit", frozen=True):
    """To a robot's process: the robot is to go there."""

    robot_id: Id
    target_id: Id
    x_m: Coordinate
    y_m: Coordinate
    timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | None
    tries: Annotated[int, msgspec.Meta(ge=1, le=1000)]


class Joined(_ReliableMessage, tag="joined", frozen=True):
    """To a robot's process: its robot is told of another."""

    robot_id: Id
    other_id: Id


class Ended(_ReliableMessage, tag="ended", frozen=True):
    """To the task planner's process: a robot is done with a target."""

    robot_id: Id
    target_id: Id
    outcome: Text
    module: Reason = ""
    reason: Reason = ""


ReliableMessage = VisitMessage | Joined | Ended


class ChannelFrame(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What one end of a channel sends at once.

    Attributes:
        epoch: which start of the sender this is; a number that no other start has.
        to: which start of the receiver it is meant for; 0 for whichever there is.
        mission: what the sender runs; only processes of one mission talk.
        ask: a number that the receiver is to repeat, which shows that it lives; 0 for none.
        answer: what the receiver has asked for; 0 for nothing.
        taken: up to which number the receiver's messages have been taken.
        first: number of the first message; they are numbered from 1 without gaps.
        messages: not acknowledged yet, oldest first.
    """

    epoch: Id
    to: Id
    mission: Text
    ask: Id = 0
    answer: Id = 0
    taken: Id = 0
    first: Id = 1
    messages: Annotated[tuple[ReliableMessage, ...], msgspec.Meta(max_length=MAX_MESSAGES)] = ()


_frame: Final = msgspec.msgpack.Decoder(ChannelFrame)


def decode_frame(data: bytes) -> ChannelFrame:
    """Decode a frame.

    Raises:
        Garbage: it is none.
    """
    return decoded(_frame, data, MAX_FRAME_BYTES, "frame")


REPEAT_S: Final = 0.2
"""What is not acknowledged is sent again after so long, and so is a question that nobody has answered."""

ALIVE_S: Final = 1.0
"""An end with nothing to say says so this often."""

MAX_WAITING: Final = 1000
"""Messages that may wait to be acknowledged; task planner and robots have a few under way."""


@dataclass(frozen=True, slots=True)
class Came:
    """The other end is there, for the first time or after a new start. Messages to an earlier start are gone."""


class Channel:
    """One end.

    A process that starts anew has a new epoch, and with it all begins anew: numbers, and messages not yet acknowledged
    are dropped, since they were for somebody who is no more. Whoever hears an epoch that it does not know asks it to
    repeat a number first: a frame that was under way for long cannot do that, so that nobody ever turns back to a
    process that has ended.

    Both ends live once: of two processes with one name no messages would arrive in order.

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
        self._waiting: Final[deque[ReliableMessage]] = deque()
        self._first = 1  # the number of the first that waits
        self._taken = 0
        self._owes_frame = False
        self._sent_s = -math.inf
        self._asked_s = -math.inf
        self._fresh = False  # something waits that was never sent

    @property
    def there(self) -> bool:
        """Whether the other end has been there, and can be sent messages; it may have ended meanwhile."""
        return self._peer != 0

    def send(self, message: ReliableMessage) -> None:
        """Send to the other end's present incarnation; dropped if none has connected.

        Raises:
            OverflowError: too many wait.
        """
        if not self.there:
            return
        if len(self._waiting) >= MAX_WAITING:
            raise OverflowError(f"{MAX_WAITING} messages wait to be acknowledged")
        self._waiting.append(message)
        self._fresh = True

    def take(self, frame: ChannelFrame) -> list[ReliableMessage | Came]:
        """Take a frame; return what follows from it, in order."""
        if frame.mission != self._mission:
            self.foreign = frame.mission
            return []
        if frame.epoch in (0, self._epoch):
            return []
        came: list[ReliableMessage | Came] = []
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
        for number, message in enumerate(frame.messages, start=frame.first):
            self._owes_frame = True
            if number == self._taken + 1:
                self._taken = number
                came.append(message)
        return came

    def due(self, now_s: float) -> list[ChannelFrame]:
        """Return the frames that are to be sent now; none most of the time."""
        frames = []
        epoch, asked = self._candidate
        if epoch and now_s - self._asked_s >= REPEAT_S:
            self._asked_s = now_s
            frames.append(ChannelFrame(self._epoch, epoch, self._mission, asked, self._answered(epoch)))
        asker = self._answer[0]
        if asker not in (0, self._peer):
            frames.append(ChannelFrame(self._epoch, asker, self._mission, 0, self._answered(asker)))
        quiet_s = now_s - self._sent_s
        at_once = self._owes_frame or self._fresh or self._answer[0] != 0
        within_s = REPEAT_S if self._waiting or not self.there else ALIVE_S
        if at_once or quiet_s >= within_s:
            self._sent_s = now_s
            self._owes_frame = self._fresh = False
            messages = tuple(self._waiting[index] for index in range(min(len(self._waiting), MAX_MESSAGES)))
            answer = self._answered(self._peer)
            frames.append(
                ChannelFrame(self._epoch, self._peer, self._mission, 0, answer, self._taken, self._first, messages)
            )
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


logger = logging.getLogger(__name__)

_EPOCH_BITS: Final = 61


def new_epoch() -> int:
    """Return a number that no other start of any process has."""
    return secrets.randbits(_EPOCH_BITS) + 1


class ReliableChannel:
    """Sends and delivers messages. One thread, but for what the bus does."""

    def __init__(self, bus: Bus, prefix: str, me: str, others: Iterable[str], mission: str) -> None:
        self._bus: Final = bus
        self._prefix: Final = prefix
        self._me: Final = me
        epoch = new_epoch()
        self._channels: Final = {name: Channel(epoch, mission, new_epoch) for name in others}
        self._said_foreign: Final[set[str]] = set()
        self._inbox: Final = BusInbox(bus, f"{prefix}/*/messages/{me}", decode_frame, lambda: 0.0)

    def send(self, to: str, message: ReliableMessage) -> None:
        """Have a message delivered to a process as it lives now; dropped while it has not come."""
        self._channels[to].send(message)

    def pump(self, now_s: float) -> list[tuple[str, ReliableMessage | Came]]:
        """Take what has come and send what is due; return what was delivered, with the process that it is from."""
        delivered: list[tuple[str, ReliableMessage | Came]] = []
        for key, frame, _ in self._inbox.take():
            sender = key.removeprefix(f"{self._prefix}/").partition("/")[0]
            channel = self._channels.get(sender)
            if channel is None:
                continue
            for each in channel.take(frame):
                if isinstance(each, Came):
                    logger.info("process '%s' is there", sender)
                delivered.append((sender, each))
            if channel.foreign and sender not in self._said_foreign:
                self._said_foreign.add(sender)
                logger.error("process '%s' runs another mission; messages to and from it are dropped", sender)
        for name, channel in self._channels.items():
            for frame in channel.due(now_s):
                self._bus.publish(f"{self._prefix}/{self._me}/messages/{name}", encode(frame))
        return delivered

    def close(self) -> None:
        """Leave the bus. Idempotent."""
        self._bus.close()
