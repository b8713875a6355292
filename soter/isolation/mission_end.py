"""The mission's end of the link: copies of the supervisor's ports, and a clock that follows the fleet's."""

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
    Begun,
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
    """A clock that goes on from the latest fleet time it was given, at the rate between the last two; never back.

    Both processes run on one host, and share its steady clock.

    Args:
        steady: the host's monotonic time in seconds.
        sleep: sleeps for a number of host seconds.
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
        """Take the fleet time at one moment of the host's steady time."""
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
    """Keeps copies of the ports in the supervisor's process. One thread, except for the ports and `busy`.

    Args:
        link: the socket to the supervisor.
        hear: called with the ports' reports, as in the supervisor's process.

    Attributes:
        clock: fleet time.
        ports: by robot id; empty before `Begin`.
        peers: likewise the ports of robots that other processes command, which show states and take no commands.
    """

    def __init__(self, link: socket.socket, hear: Callable[[Report], None]) -> None:
        self.clock: Final = FollowedClock()
        self.ports: Final[dict[int, Port[Waypoint, RobotState]]] = {}
        self.peers: Final[dict[int, Port[Waypoint, RobotState]]] = {}
        self._link: Final = link
        self._hear: Final = hear
        self._handovers: Final[dict[int, int]] = {}
        self._seen = 0

    def say(self, message: Started | Refused | Begun) -> None:
        """Send what comes before all turns. It is lost if the supervisor is gone, which `wait` then reports."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._link.send(encode(message))

    def busy(self, handler: str) -> None:
        """Report a handler that does not end. From any thread; lost if the supervisor does not read."""
        with contextlib.suppress(OSError):
            self._link.send(encode(Busy(handler)), socket.MSG_DONTWAIT)

    def wait(self) -> list[Begin | Tick] | None:
        """Wait for messages of the supervisor, and return them all, or None when it is gone.

        By then the ports show the latest states, and all reports have been heard.
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
        """Send the answer to the ticks so far; waits while the supervisor has not read earlier messages.

        Args:
            turn: the answer without `tick` and `asks`, which are filled in.
        """
        turn = msgspec.structs.replace(turn, tick=self._seen, asks=tuple(self._asks()))
        data = encode(turn)
        if len(data) > MAX_TURN_BYTES:
            # Upcoming waypoints and changes of state are for statistics only.
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
    """Return a command as a plain waypoint, or None if it is none; the supervisor's process checks its numbers."""
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
