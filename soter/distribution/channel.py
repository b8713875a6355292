"""Reliable channels over a bus that loses, doubles, delays and reorders: each message arrives once, and in order.

Messages are machine events in MessagePack, between a task planner and robot agents in other processes. They are decoded
into these types or refused; the key of a message names its sender.

A process has one `Channel` for each peer, without clock, thread or bus: frames and the time are handed in and out.
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
"""Most messages in one frame; the rest goes with the next frame."""

Coordinate = Annotated[float, msgspec.Meta(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]

MAX_REASON: Final = 100
"""Longest reason in characters: a frame of the longest messages is no longer than `MAX_FRAME_BYTES`."""

Reason = Annotated[str, msgspec.Meta(max_length=MAX_REASON)]


class _ReliableMessage(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    pass


class VisitMessage(_ReliableMessage, tag="visit", frozen=True):
    """To a robot's process: the robot is to go to a target."""

    robot_id: Id
    target_id: Id
    x_m: Coordinate
    y_m: Coordinate
    timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)] | None
    tries: Annotated[int, msgspec.Meta(ge=1, le=1000)]


class Joined(_ReliableMessage, tag="joined", frozen=True):
    """To a robot's process: another robot has joined."""

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
    """One frame from an end of a channel.

    Attributes:
        epoch: the start of the sender's process; a number that no other start has.
        to: the start of the receiver that the frame is meant for; 0 for any.
        mission: the sender's mission; only processes of one mission exchange messages.
        ask: a number that the receiver is to repeat, which shows that it lives; 0 for none.
        answer: the number that the receiver has asked for; 0 for none.
        taken: number of the receiver's latest message that has been taken.
        first: number of the first message; they are numbered from 1 without gaps.
        messages: the messages that are not acknowledged yet, oldest first.
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
    """Return the frame in bytes.

    Raises:
        Garbage: the bytes are no frame.
    """
    return decoded(_frame, data, MAX_FRAME_BYTES, "frame")


REPEAT_S: Final = 0.2
"""Time after which messages without acknowledgement, and questions without an answer, are sent again."""

ALIVE_S: Final = 1.0
"""Longest time between two frames of an end without messages."""

MAX_WAITING: Final = 1000
"""Most messages that may wait for acknowledgement; task planner and robots have a few under way."""


@dataclass(frozen=True, slots=True)
class Came:
    """The other end has connected, for the first time or after a restart. Messages to an earlier start are dropped."""


class Channel:
    """One end of a channel.

    A restarted process has a new epoch. With it numbers begin anew, and messages without acknowledgement are dropped,
    since they were for the earlier start. An end that hears an unknown epoch first asks it to repeat a number: an old,
    delayed frame cannot do that, so that no end ever turns back to a process that has ended.

    Each end must run only once: from two processes with one name messages would not arrive in order.

    Args:
        epoch: this process's epoch; above 0.
        mission: this process's mission; frames of another mission are ignored.
        draw: returns a number above 0 that was not used before.

    Attributes:
        foreign: the mission of the last frame that was ignored because of its mission; empty without one.
    """

    def __init__(self, epoch: int, mission: str, draw: Callable[[], int]) -> None:
        self.foreign = ""
        self._epoch: Final = epoch
        self._mission: Final = mission
        self._draw: Final = draw
        self._peer = 0
        self._candidate = (0, 0)  # an epoch, and the number that it was asked to repeat
        self._answer = (0, 0)  # an epoch that has asked, and the number to repeat
        self._waiting: Final[deque[ReliableMessage]] = deque()
        self._first = 1  # the number of the first waiting message
        self._taken = 0
        self._owes_frame = False
        self._sent_s = -math.inf
        self._asked_s = -math.inf
        self._fresh = False  # whether a waiting message was never sent

    @property
    def there(self) -> bool:
        """Whether the other end has connected, and can be sent messages; it may have ended meanwhile."""
        return self._peer != 0

    def send(self, message: ReliableMessage) -> None:
        """Send to the other end's present incarnation; dropped if none has connected.

        Raises:
            OverflowError: too many messages wait.
        """
        if not self.there:
            return
        if len(self._waiting) >= MAX_WAITING:
            raise OverflowError(f"{MAX_WAITING} messages wait to be acknowledged")
        self._waiting.append(message)
        self._fresh = True

    def take(self, frame: ChannelFrame) -> list[ReliableMessage | Came]:
        """Take a frame; return the messages that it delivers, in order, after a `Came` if the other end is new."""
        if frame.mission != self._mission:
            self.foreign = frame.mission
            return []
        if frame.epoch in (0, self._epoch):
            return []
        came: list[ReliableMessage | Came] = []
        mine = frame.to == self._epoch
        if frame.ask and frame.to in (0, self._epoch):
            # An earlier asker may be gone; if not, it asks again.
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
        """Return the frames that are to be sent now; mostly none."""
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
        """Return and forget the number to repeat to an epoch; 0 for none."""
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
            # The next messages are sent at once, without waiting for the time of a repetition.
            self._fresh = bool(self._waiting)


logger = logging.getLogger(__name__)

_EPOCH_BITS: Final = 61


def new_epoch() -> int:
    """Return a number that no other start of any process has."""
    return secrets.randbits(_EPOCH_BITS) + 1


class ReliableChannel:
    """Sends messages to other processes, and delivers theirs. One thread, except for the bus's."""

    def __init__(self, bus: Bus, prefix: str, me: str, others: Iterable[str], mission: str) -> None:
        self._bus: Final = bus
        self._prefix: Final = prefix
        self._me: Final = me
        epoch = new_epoch()
        self._channels: Final = {name: Channel(epoch, mission, new_epoch) for name in others}
        self._said_foreign: Final[set[str]] = set()
        self._inbox: Final = BusInbox(bus, f"{prefix}/*/messages/{me}", decode_frame, lambda: 0.0)

    def send(self, to: str, message: ReliableMessage) -> None:
        """Send a message to the present start of a process; dropped if the process has not connected."""
        self._channels[to].send(message)

    def pump(self, now_s: float) -> list[tuple[str, ReliableMessage | Came]]:
        """Take received frames and send due ones; return the delivered messages, each with its sender's name."""
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
