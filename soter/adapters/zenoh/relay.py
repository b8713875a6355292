"""A bad link, for tests: a relay between SOTER and its robots, with a session on either side."""

from __future__ import annotations

from collections.abc import Mapping
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
        prefix: what stands before them on SOTER's side; needed where both sides are one network.

    Attributes:
        session: the one on SOTER's side.
    """

    def __init__(
        self, there: SessionOptions, here: SessionOptions, namespaces: Mapping[int, str], prefix: str = ""
    ) -> None:
        super().__init__()
        self._sessions: Final[list[zenoh.Session]] = []
        try:
            for options in (there, here):
                self._sessions.append(open_session(options))
            robots, self.session = self._sessions
            for robot_id, namespace in namespaces.items():
                near, far = Keys().of(namespace), Keys().of(prefix + namespace)
                for name in _TO_ROBOT:
                    self._connect(robot_id, self.session, getattr(far, name), robots, getattr(near, name))
                for name in _TO_SOTER:
                    self._connect(robot_id, robots, getattr(near, name), self.session, getattr(far, name))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        super().close()
        for session in self._sessions:
            close_session(session)

    def _connect(self, robot_id: int, source: zenoh.Session, heard: str, sink: zenoh.Session, said: str) -> None:
        line = Line(robot_id, Voice(sink, said).say_bytes)
        messages: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_AT_ONCE)
        Listener(source.declare_subscriber(heard, messages), lambda each: self.pass_on(line, each.payload.to_bytes()))
