"""The supervisor's end of the link: nothing here waits, and the work of each call is bounded."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from soter.errors import Garbage
from soter.isolation import messages
from soter.isolation.child import Child, ChildDied
from soter.isolation.refused import Refused
from soter.rta import ControlReport, GoalReport, Port, Report, Request
from soter.sdk import Capabilities, RobotState, Waypoint

MAX_MESSAGES: Final = 4
"""Most messages that are read at one tick; a mission sends one."""

MAX_REPORTS: Final = 200
"""Most reports that are sent with one tick."""

MAX_WAITING: Final = 2000
"""Most reports that may wait for a mission that does not read."""

BEGIN_S: Final = 60.0
"""Host time that the beginning may take, when policies are loaded."""

_LOOKS: Final = 4
"""Least number of looks in a silence: if supervisor and mission were both suspended, as with their container, the
mission has not been silent."""

_CLOSED_CALLS: Final = 20
"""Calls, of which a tick makes two, to wait for the exit code of a process whose socket has closed: the socket closes
earlier, and on a busy host a process that has crashed takes a while to end."""

Ports = Mapping[int, Port[Waypoint, RobotState]]


class SupervisorEnd:
    """Exchanges messages with the mission's process. Supervisor's thread only.

    Every misbehaviour of the mission sets `failure`, and raises nothing: garbage, silence, a closed link, reports that
    it does not read. A mission that has failed is killed, and its earlier messages count no more.

    Args:
        child: the mission's process.
        silent_s: longest host time that a mission may take to answer a tick, once it has begun.
        steady: the host's monotonic time in seconds.

    Attributes:
        failure: why the mission has failed; empty while it has not.
    """

    def __init__(self, child: Child, silent_s: float, steady: Callable[[], float] = time.perf_counter) -> None:
        self.failure = ""
        self._child: Final = child
        self._silent_s: Final = silent_s
        self._steady: Final = steady
        self._ports: Ports = {}
        self._peers: tuple[int, ...] = ()
        self._handovers: dict[int, int] = {}
        self._reports: Final[deque[messages.Reported]] = deque()
        self._begun = False
        self._sent = 0
        self._answered = 0
        self._looked_steady_s = 0.0
        self._waited_s = 0.0
        self._handler = ""
        self._closed_calls = 0

    @property
    def not_begun(self) -> str:
        """Why the mission has not begun, in words; empty once it has."""
        if self._begun:
            return ""
        return "the mission has not begun" + (f"; it is in handler {self._handler}" if self._handler else "")

    # --- before the first tick ---------------------------------------------------------------------------------

    def await_start(self, limit_s: float) -> messages.Started | Refused | None:
        """Wait for the mission's first message; None if none comes in time.

        Raises:
            ChildDied: its process has ended.
            Garbage: it is no message that may come first.
        """
        data = self._child.receive(limit_s)
        if data is None:
            return None
        message = messages.decode_up(data)
        if not isinstance(message, messages.Started | Refused):
            raise Garbage("a first message of another kind")
        return message

    def begin(
        self,
        ports: Ports,
        fleet_s: float,
        rooms: tuple[messages.Footprint, ...],
        *,
        recorded: bool = False,
        peers: tuple[int, ...] = (),
        capabilities: tuple[Capabilities, ...] = (),
    ) -> None:
        """Tell the mission that its robots are ready, what they promise, and which robots other processes command."""
        self._ports, self._peers = ports, peers
        self._handovers = dict.fromkeys(ports, 0)
        self._looked_steady_s = self._steady()
        self._tell(messages.Begin(
            fleet_s, self._looked_steady_s, tuple(ports), rooms, recorded, peers, capabilities,
        ))  # fmt: skip

    # --- at every tick -----------------------------------------------------------------------------------------

    def hear(self, report: Report) -> None:
        """Queue a port's report."""
        if self.failure:
            return
        if isinstance(report, ControlReport):
            self._handovers[report.robot_id] += 1
        self._reports.append(messages.Reported.of(report))
        if len(self._reports) > MAX_WAITING:
            self.fail(f"it takes no reports: {MAX_WAITING} wait for it")

    def send(
        self, now_s: float, fleet_s: float, states: Sequence[RobotState | None], peers: Sequence[messages.PeerSeen] = ()
    ) -> None:
        """Send a tick. If the link is full, the next tick replaces it; reports are kept."""
        if self.failure:
            return
        count = min(len(self._reports), MAX_REPORTS)
        reports = tuple(self._reports[index] for index in range(count))
        if self._tell(
            messages.Tick(self._sent + 1, now_s, fleet_s, self._steady(), tuple(states), reports, tuple(peers))
        ):
            self._sent += 1
            for _ in range(count):
                self._reports.popleft()

    def receive(self) -> list[messages.Turn]:
        """Return the mission's turns since the last tick, put its requests into the ports, and check its silence.

        The turns are checked: each answers a tick that was sent, once, and names only known robots.
        """
        turns: list[messages.Turn] = []
        read = 0
        now_s = self._steady()
        self._waited_s += min(now_s - self._looked_steady_s, self._silent_s / _LOOKS)
        self._looked_steady_s = now_s
        try:
            for _ in range(MAX_MESSAGES):
                data = None if self.failure or read > messages.MAX_TURN_BYTES else self._child.receive()
                if data is None:
                    break
                read += len(data)
                message = messages.decode_up(data)
                if isinstance(message, messages.Busy):
                    self._handler = message.handler
                elif isinstance(message, messages.Turn):
                    self._check(message)
                    self._take(message)
                    turns.append(message)
                elif isinstance(message, messages.Begun) and not self._begun:
                    self._begun, self._waited_s = True, 0.0
                else:
                    raise Garbage("a first message, later")
        except ChildDied:
            self._closed()
        except Garbage as garbage:
            self.fail(f"it sent garbage: {garbage}")
        limit_s = self._silent_s if self._begun else max(self._silent_s, BEGIN_S)
        if self._sent > self._answered and self._waited_s > limit_s:
            where = f"; it is in handler {self._handler}" if self._handler else ""
            # The mission may have ended, with the link held open by a process that it had started.
            self._closed()
            self.fail(f"it has been silent for {limit_s:g} s of host time{where}")
        return turns

    def fail(self, cause: str) -> None:
        """Mark the mission as failed and kill it, without waiting for its end."""
        if not self.failure:
            self.failure = cause
            self._reports.clear()
            self._child.end()

    def _tell(self, message: messages.Begin | messages.Tick) -> bool:
        try:
            return self._child.send(messages.encode(message))
        except ChildDied:
            self._closed()
            return False

    def _closed(self) -> None:
        self._closed_calls += 1
        ended = self._child.how_it_ended()
        if ended is not None:
            self.fail(f"its process has ended with {ended}")
        elif self._closed_calls > _CLOSED_CALLS:
            self.fail("its process has closed the link")

    def _check(self, turn: messages.Turn) -> None:
        if not self._answered < turn.tick <= self._sent:
            raise Garbage(f"an answer to tick {turn.tick}, expected: {self._answered + 1} to {self._sent}")
        own = [
            *(ask.robot_id for ask in turn.asks),
            *(each.robot_id for each in turn.failures if each.robot_id is not None),
        ]
        unknown = [robot_id for robot_id in own if robot_id not in self._ports]
        # The task planner's process has targets for robots of other processes, too.
        heard_of = {*self._ports, *self._peers}
        unknown += [each.robot_id for each in turn.news if each.robot_id not in heard_of]
        if unknown:
            raise Garbage(f"there is no robot {unknown[0]}")
        for each in turn.news:
            if isinstance(each, messages.TargetGiven) and not math.isfinite(each.x_m + each.y_m):
                raise Garbage("a target that is not finite")
        if not all(math.isfinite(moved.time_s) for moved in turn.moves):
            raise Garbage("a time that is not finite")

    def _take(self, turn: messages.Turn) -> None:
        self._answered = turn.tick
        self._begun, self._waited_s = True, 0.0
        self._handler = ""
        for ask in turn.asks:
            self._ask(ask)

    def _ask(self, ask: messages.Ask) -> None:
        if ask.handover != self._handovers[ask.robot_id]:
            # A request from before a hand-over must not move the robot after it.
            self.hear(GoalReport(ask.robot_id, ask.goal_id, "rejected"))
            return
        self._ports[ask.robot_id].put(Request(ask.goal_id, ask.target, ask.upcoming))
