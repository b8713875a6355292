"""Ground truth that a simulated world sends on a channel of its own; see `soter_sim.truth_server`."""

from __future__ import annotations

import json
import logging
import math
import socket
import threading
from typing import Any, Final

from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk.values import TruthReport, Violation

logger = logging.getLogger(__name__)

_SILENT_S: Final = 1.0
_LONGEST_GAP_S: Final = 0.1
_LAG: Final = 0.1
_LONGEST_LINE: Final = 1 << 20
_TOLD: Final = {"time_s", "poses", "speeds", "violations", "min_margin", "contacts"}


class ToldTruth:
    """Ground truth of a simulated world, received over any wire; implements `soter.sdk.Truth`.

    One thread calls `hear`; any thread may ask, without waiting. A pose is the last one heard, extrapolated at its
    speed to the time of the call.

    Args:
        clock: fleet time, in which violations are reported.
    """

    def __init__(self, clock: VehicleClock) -> None:
        self._clock: Final = clock
        self._latest: dict[str, Any] | None = None
        self._offset_s = math.inf
        self._heard_s = 0.0
        self._warned = False

    @property
    def known(self) -> bool:
        """Whether anything was heard yet."""
        return self._latest is not None

    def hear(self, message: bytes) -> None:
        """Take a message of the world; see `soter_sim.truth_server`.

        Raises:
            ValueError: the message is no ground truth.
        """
        told = json.loads(message)
        if not isinstance(told, dict) or not told.keys() >= _TOLD:
            raise ValueError("this is no truth")
        heard_s = self._clock.now()
        offset_s, before = heard_s - told["time_s"], self._latest
        if before is None or told["time_s"] < before["time_s"]:
            self._offset_s = offset_s
        else:
            # The quickest message has the best offset; but on a slow host a world may fall behind, and stay there.
            lag_s = _LAG * (told["time_s"] - before["time_s"])
            self._offset_s = min(offset_s, self._offset_s + lag_s)
        self._heard_s = heard_s
        self._latest = told

    def report(self) -> TruthReport:
        """Return what has happened up to now, or up to the end of a simulator that is gone, with a warning."""
        told, offset_s = self._told(), self._offset_s
        silent_s = self._clock.now() - self._heard_s
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
            self._heard_s if silent_s > _SILENT_S else None,
            {int(robot_id): charge for robot_id, charge in told.get("charges", {}).items()},
        )

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad."""
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


class StreamedTruth(ToldTruth):
    """Reads the truth line by line from a TCP socket, in a thread of its own.

    Args:
        address: `host:port` of the world's truth.
        clock: fleet time, in which violations are reported.
        timeout_s: how long to wait for the first line.

    Raises:
        RobotUnavailable: no truth is sent there.
    """

    def __init__(self, address: str, clock: VehicleClock, timeout_s: float = 5.0) -> None:
        super().__init__(clock)
        self._address: Final = address
        self._known: Final = threading.Event()
        try:
            host, _, port = address.rpartition(":")
            self._socket: Final = socket.create_connection((host, int(port)), timeout_s)
        except (OSError, ValueError) as failure:
            raise self._nobody(str(failure)) from failure
        self._socket.settimeout(None)
        self._thread: Final = threading.Thread(target=self._listen, name="truth", daemon=True)
        self._thread.start()
        if not self._known.wait(timeout_s):
            self.close()
            raise self._nobody(f"it was silent for {timeout_s:g} s")

    def close(self) -> None:
        """End the thread and close the socket; what was heard stays readable. Idempotent."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            # The other side is gone already.
            logger.debug("the truth's socket was closed before")
        self._thread.join()
        self._socket.close()

    def _nobody(self, why: str) -> RobotUnavailable:
        return RobotUnavailable(
            f"no truth comes from {self._address} ({why}); is the simulator running, and is the address "
            "of its truth right?"
        )

    def _listen(self) -> None:
        with self._socket.makefile("rb") as lines:
            while True:
                try:
                    line = lines.readline(_LONGEST_LINE)
                except OSError:
                    return
                if not line:
                    return
                try:
                    self.hear(line)
                except ValueError as failure:
                    logger.warning("a line of the simulator's truth makes no sense and was dropped: %s", failure)
                else:
                    self._known.set()
