"""Hears everything that arrives, in one thread: what is newest is kept, nothing is queued."""

from __future__ import annotations

import json
import logging
import math
import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

import zmq

from soter.clock import Clock, VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import TruthReport, Violation
from soter_zmq.wire import PERIOD_S

logger = logging.getLogger(__name__)

_LOOK_MS: Final = 50
_LONGEST_GAP_S: Final = 2.0 * PERIOD_S
_SILENT_S: Final = 1.0
_TOLD: Final = {"time_s", "poses", "speeds", "violations", "min_margin", "contacts"}

Hear = Callable[[bytes, float], None]
"""Takes a message and the steady time at which it was received; raises ValueError for one that makes no sense."""


class Receiver:
    """A thread that hands every message to whom it is for.

    Args:
        context: for the sockets.
        clock: tells when a message was received.
        sources: addresses to listen to, and who hears what comes from there.
    """

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], clock: Clock, sources: Mapping[str, Hear]) -> None:
        self._clock: Final = clock
        self._done: Final = threading.Event()
        self._heard: Final = threading.Condition()
        self._hears: Final[dict[zmq.Socket[bytes], Hear]] = {}
        for address, hear in sources.items():
            socket = context.socket(zmq.SUB)
            # The socket keeps the last message only, so that who is slow hears what is new and not what is first.
            socket.setsockopt(zmq.CONFLATE, 1)
            socket.setsockopt(zmq.RECONNECT_IVL, 50)
            socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
            socket.setsockopt(zmq.SUBSCRIBE, b"")
            socket.connect(address)
            self._hears[socket] = hear
        self._thread: Final = threading.Thread(target=self._run, name="zmq-receiver", daemon=True)
        self._thread.start()

    def wait_for(self, predicate: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until something that was heard makes the predicate true; return whether it is."""
        with self._heard:
            return self._heard.wait_for(predicate, max(0.0, timeout_s))

    def close(self) -> None:
        """End the thread and close its sockets. Idempotent."""
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        poller = zmq.Poller()
        for socket in self._hears:
            poller.register(socket, zmq.POLLIN)
        try:
            while not self._done.is_set():
                for socket, _ in poller.poll(_LOOK_MS):
                    self._take(socket)
        finally:
            for socket in self._hears:
                socket.close()

    def _take(self, socket: zmq.Socket[Any]) -> None:
        try:
            message: bytes = socket.recv(zmq.NOBLOCK)
            received_s = self._clock.steady_s()
            self._hears[socket](message, received_s)
        except zmq.Again:
            return
        except ValueError as failure:
            # Whoever it is from goes on being old until it sends something better.
            logger.warning("a message that makes no sense was dropped: %s", failure)
            return
        with self._heard:
            self._heard.notify_all()


class StreamedTruth:
    """What the simulator says that really happens; implements `soter.sdk.Truth`.

    It comes on a socket of its own and never through a robot. Asking waits for nothing: a pose is the last one heard,
    moved on at its speed to the time of asking, which is less than two periods later unless the simulator is gone.

    Args:
        clock: fleet time, in which violations are told.
    """

    def __init__(self, clock: VehicleClock) -> None:
        self._clock: Final = clock
        self._latest: dict[str, Any] | None = None
        self._offset_s = 0.0
        self._warned = False

    @property
    def known(self) -> bool:
        """Whether anything was heard."""
        return self._latest is not None

    def hear(self, message: bytes, received_s: float) -> None:
        """Take a message of the simulator. Called by the receiver's thread."""
        told = _checked(message)
        offset_s = self._clock.now() - told["time_s"]
        before = self._latest
        if before is None or told["time_s"] < before["time_s"] or offset_s < self._offset_s:
            self._offset_s = offset_s
        self._latest = told

    def report(self) -> TruthReport:
        """Return what has happened up to now; of a simulator that is gone, up to its end, with a warning."""
        told, offset_s = self._told(), self._offset_s
        silent_s = self._clock.now() - told["time_s"] - offset_s
        if silent_s > _SILENT_S and not self._warned:
            self._warned = True
            logger.warning("the simulator has been silent for %.1f s; what happened since then is not known", silent_s)
        return TruthReport(
            tuple(
                Violation(rule, tuple(robots), begin_s + offset_s, None if end_s is None else end_s + offset_s)
                for rule, robots, begin_s, end_s in told["violations"]
            ),
            told["min_margin"],
            told["contacts"],
            told["time_s"] + offset_s if silent_s > _SILENT_S else None,
        )

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot is: x_m, y_m, heading_rad."""
        told = self._told()
        x_m, y_m, heading_rad = told["poses"][str(robot_id)]
        v_m_s, yaw_rate_rad_s = told["speeds"][str(robot_id)]
        later_s = min(max(self._clock.now() - told["time_s"] - self._offset_s, 0.0), _LONGEST_GAP_S)
        length_m, turn_rad = v_m_s * later_s, yaw_rate_rad_s * later_s
        middle_rad = heading_rad + 0.5 * turn_rad
        return (
            x_m + length_m * math.cos(middle_rad),
            y_m + length_m * math.sin(middle_rad),
            math.remainder(heading_rad + turn_rad, 2.0 * math.pi),
        )

    def _told(self) -> dict[str, Any]:
        if self._latest is None:
            raise RobotUnavailable("the simulator has not said yet what really happens; is its truth address right?")
        return self._latest


def _checked(message: bytes) -> dict[str, Any]:
    told = json.loads(message)
    if (
        not isinstance(told, dict)
        or not {"time_s", "poses", "speeds", "violations", "min_margin", "contacts"} <= told.keys()
    ):
        raise ValueError("this is no truth")
    return told
