"""The mission's end of the link: ports like the supervisor's own, and a clock that follows the fleet's."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Callable, Sequence
from numbers import Real
from typing import Any, Final

import msgspec

from soter.clock import Clock
from soter.isolation.child import MAX_MESSAGE_BYTES
from soter.isolation.messages import (
    MAX_ANNOUNCED,
    MAX_TURN_BYTES,
    Ask,
    Begin,
    Busy,
    Started,
    Tick,
    Turn,
    decode_down,
    encode,
)
from soter.isolation.refused import Refused
from soter.isolation.watched_port import WatchedPort
from soter.rta import Port, Report
from soter.sdk import RobotState, Waypoint

_SHORTEST_SLEEP_S: Final = 1e-3
_LONGEST_SLEEP_S: Final = 0.25


class FollowedClock(Clock):
    """Goes on from the time that was told last, at the rate between the last two; never back.

    Both processes run on one host, whose steady clock they share.

    Args:
        steady: the host's monotonic time in seconds.
        sleep: sleeps for so many seconds of the host.
    """

    def __init__(
        self, *, steady: Callable[[], float] = time.perf_counter, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._steady: Final = steady
        self._sleep: Final = sleep
        self._told_s = 0.0
        self._told_steady_s = math.nan
        self._rate = 1.0
        self._shown_s = 0.0

    def follow(self, fleet_s: float, steady_s: float) -> None:
        """Take what the fleet's clock showed at one moment of the host's steady time."""
        passed_s = steady_s - self._told_steady_s
        if passed_s > 0.0:
            self._rate = max(0.0, (fleet_s - self._told_s) / passed_s)
        self._told_s, self._told_steady_s = fleet_s, steady_s

    def now(self) -> float:
        if math.isfinite(self._told_steady_s):
            self._shown_s = max(
                self._shown_s, self._told_s + max(0.0, self._steady() - self._told_steady_s) * self._rate
            )
        return self._shown_s

    def sleep_until(self, time_s: float) -> None:
        while (left_s := time_s - self.now()) > 0.0:
            self._sleep(min(max(left_s, _SHORTEST_SLEEP_S), _LONGEST_SLEEP_S))

    def steady_s(self) -> float:
        return self._steady()


class MissionEnd:
    """Keeps ports that mean the same as those in the supervisor's process. One thread, but for the ports and `busy`.

    Args:
        link: the socket to the supervisor.
        hear: told what the ports report, as in the supervisor's process.

    Attributes:
        clock: fleet time.
        ports: by robot; empty before `Begin`.
        peers: those of robots that other processes command, likewise; they show where these are and take nothing.
    """

    def __init__(self, link: socket.socket, hear: Callable[[Report], None]) -> None:
        self.clock: Final = FollowedClock()
        self.ports: Final[dict[int, Port[Waypoint, RobotState]]] = {}
        self.peers: Final[dict[int, Port[Waypoint, RobotState]]] = {}
        self._link: Final = link
        self._hear: Final = hear
        self._handovers: Final[dict[int, int]] = {}
        self._seen = 0

    def say(self, message: Started | Refused) -> None:
        """Send a first message. Lost where the supervisor is gone, which `wait` then says."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._link.send(encode(message))

    def busy(self, handler: str) -> None:
        """Name the handler that does not end; any thread may. Lost where the supervisor does not read."""
        with contextlib.suppress(OSError):
            self._link.send(encode(Busy(handler)), socket.MSG_DONTWAIT)

    def wait(self) -> list[Begin | Tick] | None:
        """Wait until the supervisor says something; return all that it has said, or None when it is gone.

        The ports show all of it by then, and what they have to report has been heard.
        """
        messages: list[Begin | Tick] = []
        flags = 0
        while True:
            try:
                data = self._link.recv(MAX_MESSAGE_BYTES, flags)
            except BlockingIOError:
                break
            except ConnectionResetError:
                return None
            if not data:
                return None
            messages.append(decode_down(data))
            flags = socket.MSG_DONTWAIT
        for message in messages:
            self.clock.follow(message.fleet_s, message.steady_s)
            if isinstance(message, Begin):
                self.ports.update({robot_id: Port(robot_id, self._hear) for robot_id in message.robot_ids})
                self.peers.update({robot_id: WatchedPort(robot_id) for robot_id in message.peer_ids})
                self._handovers.update(dict.fromkeys(message.robot_ids, 0))
            else:
                self._show(message)
        return messages

    def answer(self, turn: Turn) -> None:
        """Send what was done about the ticks up to now; waits while the supervisor has not read what was sent before.

        Args:
            turn: without its tick and what is asked for, which are filled in.
        """
        turn = msgspec.structs.replace(turn, tick=self._seen, asks=tuple(self._asks()))
        data = encode(turn)
        if len(data) > MAX_TURN_BYTES:
            # What ACs intend, and how they came to it, is for statistics only.
            asks = tuple(msgspec.structs.replace(ask, upcoming=()) for ask in turn.asks)
            data = encode(msgspec.structs.replace(turn, asks=asks, moves=()))
        self._link.send(data)

    def _show(self, tick: Tick) -> None:
        self._seen = tick.number
        for port, state in zip(self.ports.values(), tick.states, strict=True):
            port.state = state
        for port, seen in zip(self.peers.values(), tick.peers, strict=True):
            port.state, port.engaged = seen.state, seen.engaged
        for goal, control in ((report.goal, report.control) for report in tick.reports):
            if control is not None:
                self._handovers[control.robot_id] += 1
                self.ports[control.robot_id].control(control.engaged, control.module, control.cause)
            elif goal is not None:
                self._hear(goal)

    def _asks(self) -> Sequence[Ask]:
        asks = []
        for robot_id, port in self.ports.items():
            if not port.engaged:
                port.refuse()
                continue
            request = port.take()
            if request is None:
                continue
            target = _plain(request.command)
            if target is None:
                port.report(request.goal_id, "rejected")
                continue
            upcoming = _upcoming(request.upcoming)
            asks.append(Ask(robot_id, self._handovers[robot_id], request.goal_id, target, upcoming))
        return asks


def _plain(command: Any) -> Waypoint | None:
    """Return a command as it can cross, or None if it is no waypoint; what its numbers mean is judged there."""
    if type(command) is not Waypoint:
        return None
    try:
        values: tuple[object, ...] = command
        plain = [float(value) if isinstance(value, Real) else value for value in values]
        return msgspec.convert(plain, Waypoint)
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - they are the AC's own objects
        return None


def _upcoming(waypoints: Any) -> tuple[Waypoint, ...]:
    if not isinstance(waypoints, tuple):
        return ()
    plain = (_plain(each) for each in waypoints[:MAX_ANNOUNCED])
    return tuple(each for each in plain if each is not None and math.isfinite(each.x_m + each.y_m))
