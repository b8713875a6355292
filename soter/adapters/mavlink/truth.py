"""What the simulated world says that really happens: lines of JSON over TCP, on a channel of its own."""

from __future__ import annotations

import json
import logging
import math
import socket
import threading
from typing import Any, Final, NamedTuple

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import TruthReport, Violation

logger = logging.getLogger(__name__)

_LINE_MOST: Final = 1 << 16
_CONNECT_S: Final = 5.0
_LOOK_S: Final = 0.1
_GAP_S: Final = 0.1
_SILENT_S: Final = 1.0


class _Told(NamedTuple):
    """One line: what is known of a moment."""

    offset_s: float
    time_s: float
    robots: dict[str, Any]
    open: list[Any]
    min_margin: dict[str, float]
    contacts: int


class StreamedTruth:
    """Hears the truth in a thread of its own; implements `soter.sdk.Truth`.

    Asking waits for nothing: a pose is the last one heard, moved on at its velocity to the time of asking.

    Args:
        clock: fleet time, in which violations are told.
        address: host:port.

    Raises:
        RobotUnavailable: nobody tells the truth there.
    """

    def __init__(self, clock: VehicleClock, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._clock: Final = clock
        self._address: Final = address
        self._ended: Final[list[Violation]] = []
        self._latest: _Told | None = None
        self._warned = False
        self._done: Final = threading.Event()
        self._first: Final = threading.Event()
        try:
            self._socket: Final = socket.create_connection((host, int(port)), timeout=_CONNECT_S)
        except (OSError, ValueError) as failure:
            raise RobotUnavailable(
                f"nobody tells at {address} what really happens ({failure}); is the simulator running, and is 'truth' "
                "right?"
            ) from failure
        self._socket.settimeout(_LOOK_S)
        self._thread: Final = threading.Thread(target=self._run, name="mavlink-truth", daemon=True)
        self._thread.start()
        if not self._first.wait(_CONNECT_S):
            self.close()
            raise RobotUnavailable(f"at {address} nothing is told of what really happens; is 'truth' right?")

    def close(self) -> None:
        """End the thread. Idempotent."""
        self._done.set()
        self._thread.join()
        self._socket.close()

    def report(self) -> TruthReport:
        """Return what has happened up to now; of a simulator that is gone, up to its end, with a warning."""
        told = self._told()
        silent_s = self._clock.now() - told.time_s - told.offset_s
        if silent_s > _SILENT_S * self._clock.rate and not self._warned:
            self._warned = True
            logger.warning("the simulator has been silent for %.1f s; what happened since then is not known", silent_s)
        still_open = [
            Violation(rule, tuple(robots), start_s + told.offset_s, None) for rule, robots, start_s in told.open
        ]
        ended = sorted([*self._ended, *still_open], key=lambda each: each.start_s)
        return TruthReport(tuple(ended), told.min_margin, told.contacts)

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot is: x_m, y_m, heading_rad."""
        told = self._told()
        robot = told.robots[str(robot_id)]
        x_m, y_m, _, heading_rad = robot["pose"]
        east_m_s, north_m_s, _, yaw_rate_rad_s = robot["velocity"]
        later_s = min(max(self._clock.now() - told.time_s - told.offset_s, 0.0), _GAP_S)
        return (
            x_m + east_m_s * later_s,
            y_m + north_m_s * later_s,
            math.remainder(heading_rad + yaw_rate_rad_s * later_s, 2.0 * math.pi),
        )

    def _told(self) -> _Told:
        told = self._latest
        assert told is not None
        return told

    # --- the thread ----------------------------------------------------------------------------------------

    def _run(self) -> None:
        pending = b""
        while not self._done.is_set():
            try:
                data = self._socket.recv(_LINE_MOST)
            except TimeoutError:
                continue
            except OSError as failure:
                logger.debug("the truth at %s is gone: %s", self._address, failure)
                return
            if not data:
                return
            *lines, pending = (pending + data).split(b"\n")
            for line in lines:
                self._hear(line)
            if len(pending) > _LINE_MOST:
                logger.warning("what %s tells is no truth", self._address)
                return

    def _hear(self, line: bytes) -> None:
        try:
            said = json.loads(line)
            time_s, before = float(said["time_s"]), self._latest
            offset_s = self._clock.now() - time_s
            if before is not None:
                # The quickest line says it best. It may be slower by and by, as clocks drift and worlds lag.
                drift_s = _DRIFT * max(0.0, time_s - before.time_s)
                offset_s = min(offset_s, before.offset_s + drift_s)
            for rule, robots, start_s, end_s in said["closed"]:
                self._ended.append(Violation(rule, tuple(robots), start_s + offset_s, end_s + offset_s))
            self._latest = _Told(
                offset_s, time_s, said["robots"], said["open"], said["min_margin"], said["contacts"]
            )  # fmt: skip
        except (ValueError, KeyError, TypeError) as failure:
            logger.warning("a line that is no truth was dropped: %s", failure)
            return
        self._first.set()


_DRIFT: Final = 0.1
