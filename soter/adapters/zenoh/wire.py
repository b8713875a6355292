"""All messages between SOTER and one robot on Zenoh keys."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import zenoh

from soter.adapters.zenoh.messages import BatteryState, Odometry, String
from soter.adapters.zenoh.options import ZenohConfig
from soter.adapters.zenoh.session import why_not_reached
from soter.adapters.zenoh.session_options import Endpoint
from soter.adapters.zenoh.talk import Ear, Presence, Voice, announce, hear_velocity, make_velocity, stamp_of
from soter.onboard.wire import AC, SC

KEPT_S: Final = 1.0
"""A mux passes on no velocity that is older than this, wherever it waited."""

_ROUNDING: Final = 1e-6


class Said:
    """The recent velocities that a mux may pass on, to tell other programs' velocities from. From any thread."""

    def __init__(self) -> None:
        self._said: Final[deque[tuple[float, float, float]]] = deque(maxlen=400)

    def note(self, forward_m_s: float, turn_rad_s: float, now_s: float) -> None:
        """Note a velocity that was sent to the mux."""
        self._said.append((now_s, forward_m_s, turn_rad_s))

    def explains(self, forward_m_s: float, turn_rad_s: float, now_s: float) -> bool:
        """Return whether a velocity is rest, or a recently noted one, which the mux may have limited."""
        if not forward_m_s and not turn_rad_s:
            return True
        return any(
            now_s - then_s <= KEPT_S and _within(forward_m_s, forward) and _within(turn_rad_s, turn)
            for then_s, forward, turn in self._said.copy()
        )


def _within(passed: float, asked: float) -> bool:
    return min(0.0, asked) - _ROUNDING <= passed <= max(0.0, asked) + _ROUNDING


logger = logging.getLogger(__name__)


class Wire:
    """The messages from and to one robot, and the programs that are announced for it.

    Attributes:
        keys: the robot's keys, in full.
        presence: the announced programs.
        ears: by the name of the key in `Keys`. That of `cmd_vel_sc` hears only other sessions.
    """

    def __init__(self, session: zenoh.Session, config: ZenohConfig, namespace: str, who: str) -> None:
        keys = config.keys.of(namespace)
        self.keys: Final = keys
        self.presence: Final = Presence(session, namespace)
        self.ears: Final[dict[str, Ear[Any]]] = {}
        self._session: Final = session
        self._namespace: Final = namespace
        self._config: Final = config
        self._token: Final = announce(session, namespace, who)
        self._velocities: Final = {AC: Voice(session, keys.cmd_vel_ac), SC: Voice(session, keys.cmd_vel_sc)}
        self._orders: Final = Voice(session, keys.order)
        self._forged: Callable[[], object] = lambda: None
        self._said: Final = Said()

    def listen(
        self,
        take_odometry: Callable[[Odometry], object],
        take_battery: Callable[[BatteryState], object],
        take_report: Callable[[str], object],
    ) -> None:
        """Call the functions with the robot's messages from now on, each kind in a thread of its own."""
        session, keys, ears = self._session, self.keys, self.ears
        ears["cmd_vel_sc"] = self._hear_velocity(keys.cmd_vel_sc, self._warn_of_forger)
        ears["gate"] = Ear(session, keys.gate, String, lambda message: take_report(message.data))
        if keys.battery:
            ears["battery"] = Ear(session, keys.battery, BatteryState, take_battery)
        ears["odom"] = Ear(session, keys.odom, Odometry, take_odometry)

    def send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float, clock_s: float) -> None:
        """Send a velocity as a controller, with a time of the robot's clock."""
        stamp = stamp_of(clock_s) if self._config.stamped else None
        self._said.note(forward_m_s, turn_rad_s, time.monotonic())
        self._velocities[by].say(make_velocity(forward_m_s, turn_rad_s, stamp))

    def send_order(self, text: str) -> None:
        """Send an order: the active controller, and the lease."""
        self._orders.say(String(text))

    def missing(self) -> list[str]:
        """Return which messages and programs are missing, one line each."""
        found = self._no_link()
        if found:
            return found
        for name, ear in self.ears.items():
            if ear.foreign:
                found.append(f"what came on {ear.key} was no {ear.kind.__name__} ({ear.foreign} messages)")
            elif not ear.heard and not name.startswith("cmd_vel"):
                found.append(f"nothing was heard on {ear.key}")
        there = sorted(self.presence.there & {"base", "mux"})
        if there:
            found.append(f"the robot announces its {' and '.join(there)}")
        elif self.presence.there:
            found.append(f"no mux is announced below {self._namespace}")
        return found

    def others(self, listen_s: float) -> list[str]:
        """Listen for a while, and return how other programs drive the robot past its mux, one line each."""
        past: list[str] = []

        def note(forward_m_s: float, turn_rad_s: float) -> None:
            # The mux itself publishes rest on this key all the time.
            if forward_m_s or turn_rad_s:
                past.append(f"another program publishes velocities on {self.keys.cmd_vel} and drives it past the mux")

        ear = self._hear_velocity(self.keys.cmd_vel, note)
        time.sleep(listen_s)
        ear.close()
        forged = f"another program publishes velocities on {self.keys.cmd_vel_sc}, in its safe controller's name"
        return [*past[:1], *([forged] if self.ears["cmd_vel_sc"].heard else [])]

    def watch(self, intruder: Callable[[str], object]) -> None:
        """Call `intruder` from now on when another program moves the robot, or sends as its safe controller.

        Velocities for the base are compared with those sent to the mux. A program that repeats these is not noticed.
        """

        def heard(forward_m_s: float, turn_rad_s: float) -> None:
            if not self._said.explains(forward_m_s, turn_rad_s, time.monotonic()):
                intruder(f"another program publishes velocities on {self.keys.cmd_vel} and drives it past the mux")

        # A user's own AC may send any velocity to the mux.
        self.ears["cmd_vel_ac"] = self._hear_velocity(
            self.keys.cmd_vel_ac, lambda forward, turn: self._said.note(forward, turn, time.monotonic())
        )
        self.ears["cmd_vel"] = self._hear_velocity(self.keys.cmd_vel, heard)
        self._forged = lambda: intruder(
            f"another program publishes velocities on {self.keys.cmd_vel_sc}, in its safe controller's name"
        )

    def _no_link(self) -> list[str]:
        """Return why there is no link, one line for each endpoint to connect to; empty if there is a link."""
        options = self._config.session
        if self._session.info.links():
            return []
        if not options.connect:
            return ["no peer has connected, and session.connect names none"]
        return [f"no link to {text}: {why_not_reached(Endpoint.parse(text), options.tls)}" for text in options.connect]

    def _hear_velocity(self, key: str, take: Callable[[float, float], object]) -> Ear[Any]:
        return hear_velocity(self._session, key, take, stamped=self._config.stamped, elsewhere_only=True)

    def _warn_of_forger(self, *_velocity: float) -> None:
        if self.ears["cmd_vel_sc"].heard == 1:
            logger.warning("%s: another program speaks for its safe controller", self.keys.cmd_vel_sc)
        self._forged()
