"""A bad link, for tests: a relay between SOTER and its robots, with a session on either side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

import zenoh

from soter.adapters.zenoh.options import Keys
from soter.adapters.zenoh.session import SessionOptions, close_session, open_session
from soter.adapters.zenoh.talk import Listener, Voice
from soter.conformance.impaired import ImpairedRelay, Line

_TO_ROBOT: Final = ("order", "cmd_vel_ac", "cmd_vel_sc")
_TO_SOTER: Final = ("odom", "battery", "gate")
_AT_ONCE: Final = 256


class Relay(ImpairedRelay):
    """Passes messages on, both ways. The two sides know nothing of each other.

    Args:
        there: how the robots are reached.
        here: how SOTER reaches the relay.
        namespaces: by robot, what its keys begin with.

    Attributes:
        session: the one on SOTER's side.
    """

    def __init__(self, there: SessionOptions, here: SessionOptions, namespaces: Mapping[int, str]) -> None:
        super().__init__()
        self._sessions: Final[list[zenoh.Session]] = []
        try:
            for options in (there, here):
                self._sessions.append(open_session(options))
            robots, self.session = self._sessions
            for robot_id, namespace in namespaces.items():
                keys = Keys().of(namespace)
                self._connect(robot_id, self.session, robots, [getattr(keys, name) for name in _TO_ROBOT])
                self._connect(robot_id, robots, self.session, [getattr(keys, name) for name in _TO_SOTER])
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        super().close()
        for session in self._sessions:
            close_session(session)

    def _connect(self, robot_id: int, source: zenoh.Session, sink: zenoh.Session, keys: Iterable[str]) -> None:
        for key in keys:
            line = Line(robot_id, Voice(sink, key).say_bytes)
            messages: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_AT_ONCE)
            Listener(source.declare_subscriber(key, messages), _passing(self, line))


def _passing(relay: Relay, line: Line) -> Callable[[zenoh.Sample], None]:
    return lambda sample: relay.pass_on(line, sample.payload.to_bytes())
