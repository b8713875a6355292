"""Receives and sends messages on Zenoh keys, without waiting, and with all failures counted."""

from __future__ import annotations

import atexit
import logging
import threading
from collections.abc import Callable
from typing import Any, Final, Generic
from weakref import WeakSet

import zenoh

from soter.adapters.zenoh.messages import Foreign, Header, Message, Time, Twist, TwistStamped, Vector3, decode, encode
from soter.errors import RobotUnavailable

logger = logging.getLogger(__name__)

_END_TIMEOUT_S: Final = 2.0

_listening: Final[WeakSet[Listener]] = WeakSet()


@atexit.register
def _end_all() -> None:
    """End all listeners: a thread that waits in Zenoh while the interpreter ends crashes the whole process."""
    for listener in [*_listening]:
        listener.close()


class Listener:
    """Hands on the samples of a subscriber, in a thread of its own, until it or its session is closed.

    Zenoh swallows exceptions of a callback. Here exceptions of `take` are counted, and the first is logged.

    Args:
        subscriber: with a handler whose `recv` blocks.
        take: called with each sample, in the listener's thread.

    Attributes:
        failed: on how many samples `take` has raised.
    """

    def __init__(self, subscriber: Any, take: Callable[[zenoh.Sample], object]) -> None:
        self.failed = 0
        self._subscriber: Final = subscriber
        # The handler, not the subscriber: a subscriber whose `recv` waits cannot be ended.
        self._samples: Final = subscriber.handler
        self._take: Final = take
        self._name: Final = str(subscriber.key_expr)
        self._thread: Final = threading.Thread(target=self._listen, name=f"hears {self._name}", daemon=True)
        _listening.add(self)
        self._thread.start()

    def close(self) -> None:
        """End the subscription, and wait for the thread. Idempotent; not to be called from that thread."""
        if not self._thread.is_alive():
            return
        try:
            self._subscriber.undeclare()
        except zenoh.ZError as failure:
            logger.debug("%s: closed before: %s", self._name, failure)
        self._thread.join(_END_TIMEOUT_S)

    def _listen(self) -> None:
        while True:
            try:
                sample = self._samples.recv()
            except zenoh.ZError:
                # The subscriber, or its session, was closed.
                return
            try:
                self._take(sample)
            except Exception:
                self.failed += 1
                if self.failed == 1:
                    logger.exception("%s: dropped what could not be taken", self._name)


class Ear(Listener, Generic[Message]):
    """Receives the messages of one key in a thread of its own, always the newest: older ones are skipped.

    A payload that is no such message is counted and dropped; the first is logged.

    Args:
        session: an open session; once it is closed, nothing is heard any more.
        key: the key.
        kind: the kind of its messages.
        take: called with each message, in the ear's thread.
        elsewhere_only: whether to leave out this session's own messages.

    Attributes:
        heard: how many messages came.
        foreign: how many payloads were no such message.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        kind: type[Message],
        take: Callable[[Message], object],
        *,
        elsewhere_only: bool = False,
    ) -> None:
        self.key: Final = key
        self.heard = self.foreign = 0
        self.kind: Final[type[Message]] = kind
        self._take_message: Final[Callable[[Message], object]] = take
        origin = zenoh.Locality.REMOTE if elsewhere_only else zenoh.Locality.ANY
        newest: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1)
        super().__init__(session.declare_subscriber(key, newest, allowed_origin=origin), self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        try:
            message = decode(self.kind, sample.payload.to_bytes())
        except Foreign as failure:
            self.foreign += 1
            if self.foreign == 1:
                logger.warning("%s: dropped what is no %s: %s", self.key, self.kind.__name__, failure)
            return
        self.heard += 1
        self._take_message(message)


class Voice:
    """Sends messages on one key without delay; a congested link drops them. From any thread."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.key: Final = key
        # Not express: each message would fill one of the few places of the queue.
        self._publisher: Final = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.REAL_TIME
        )

    def say(self, message: Any) -> None:
        """Send a message, one of `messages.KINDS`. Never waits.

        Raises:
            RobotUnavailable: the session is closed.
            ValueError: a value does not fit the message.
        """
        self.say_bytes(encode(message))

    def say_bytes(self, payload: bytes) -> None:
        """Send a message that is encoded already.

        Raises:
            RobotUnavailable: the session is closed.
        """
        try:
            self._publisher.put(payload)
        except zenoh.ZError as failure:
            raise RobotUnavailable(f"{self.key}: nothing can be sent any more: {failure}") from failure


_ALIVE: Final = "soter/alive"
_AT_ONCE: Final = 64


def announce(session: zenoh.Session, namespace: str, who: str) -> zenoh.LivelinessToken:
    """Announce a program of a robot, such as its "mux", for as long as the session lives."""
    return session.liveliness().declare_token(f"{namespace}/{_ALIVE}/{who}")


class Presence(Listener):
    """The announced programs of one robot, received in a thread of its own.

    Zenoh removes the announcement of a program when its session ends or its link breaks. It is only used in messages
    to users. No decision depends on it: the announcement of a program that hangs stays.

    Args:
        session: an open session; once it is closed, nothing is heard any more.
        namespace: the robot's namespace.

    Attributes:
        there: the names of the programs, such as "mux" and "base".
    """

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self.there: frozenset[str] = frozenset()
        self._namespace: Final = namespace
        changes: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_AT_ONCE)
        subscriber = session.liveliness().declare_subscriber(f"{namespace}/{_ALIVE}/*", changes, history=True)
        super().__init__(subscriber, self._note)

    def _note(self, change: zenoh.Sample) -> None:
        who = str(change.key_expr).rpartition("/")[2]
        if change.kind == zenoh.SampleKind.PUT:
            self.there |= {who}
        elif who in self.there:
            self.there -= {who}
            logger.warning("%s: its %s has gone, or the link to it", self._namespace, who)


def make_velocity(forward_m_s: float, turn_rad_s: float, stamp: Time | None = None) -> Twist | TwistStamped:
    """Return a velocity as a message: a TwistStamped if there is a stamp."""
    twist = Twist(Vector3(x=forward_m_s), Vector3(z=turn_rad_s))
    return twist if stamp is None else TwistStamped(Header(stamp), twist)


def hear_velocity(
    session: zenoh.Session,
    key: str,
    take: Callable[[float, float], object],
    *,
    stamped: bool,
    elsewhere_only: bool = False,
) -> Ear[Twist] | Ear[TwistStamped]:
    """Return an ear for velocities on a key.

    Args:
        session: an open session.
        key: the key.
        take: called with each velocity, in m/s along the heading and rad/s counter-clockwise, in the ear's thread.
        stamped: whether velocities are TwistStamped.
        elsewhere_only: whether to leave out this session's own messages.
    """

    def take_twist(twist: Twist) -> None:
        take(twist.linear.x, twist.angular.z)

    if stamped:
        return Ear(session, key, TwistStamped, lambda message: take_twist(message.twist), elsewhere_only=elsewhere_only)
    return Ear(session, key, Twist, take_twist, elsewhere_only=elsewhere_only)


def stamp_of(clock_s: float) -> Time:
    """Return a time in seconds as a message's stamp."""
    seconds, nanoseconds = divmod(round(clock_s * 1e9), 1_000_000_000)
    return Time(seconds, nanoseconds)
