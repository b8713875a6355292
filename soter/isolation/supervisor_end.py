"""The supervisor's end of the link: nothing here waits, and nothing takes longer than a bounded number of bytes."""

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
"""Messages that are read at one tick; a mission sends one."""

MAX_REPORTS: Final = 200
"""Reports that go with one tick."""

MAX_WAITING: Final = 2000
"""Reports that may wait for a mission that does not read."""

_LOOKS: Final = 4
"""A silence is that of so many looks at least: a supervisor that was stopped, as with its container, has not waited for
a mission that was stopped, too."""

_CLOSED_TICKS: Final = 3
"""A socket closes a moment before its process ends; so long it is waited for how."""

Ports = Mapping[int, Port[Waypoint, RobotState]]


class SupervisorEnd:
    """Speaks with the mission's process. One thread: the supervisor's.

    Whatever the mission does ends in `failure`, never in an exception: garbage, silence, a closed link, reports that
    nobody takes. A mission that has failed is killed, and nothing that it said before counts any more.

    Args:
        child: the mission's process.
        silent_s: host time for which a mission that has been told of a tick may be silent.
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
        self._sent = 0
        self._answered = 0
        self._looked_steady_s = 0.0
        self._waited_s = 0.0
        self._handler = ""
        self._closed_ticks = 0

    # --- before the first tick ---------------------------------------------------------------------------------

    def await_start(self, limit_s: float) -> messages.Started | Refused | None:
        """Wait for the mission's first message; None if none comes in time.

        Raises:
            ChildDied: its process has ended.
            Garbage: it is none that may come first.
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
        """Queue what a port reports."""
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
        """Tell of a tick. Where there is no room the next one takes its place; what was reported is kept."""
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
        """Return what the mission has said since the last tick, put what it asks for into the ports, judge its silence.

        The turns are checked: they answer ticks that were sent, each once, and concern robots that there are.
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
                else:
                    raise Garbage("a first message, later")
        except ChildDied:
            self._closed()
        except Garbage as garbage:
            self.fail(f"it sent garbage: {garbage}")
        if self._sent > self._answered and self._waited_s > self._silent_s:
            where = f"; it is in handler {self._handler}" if self._handler else ""
            # A process that it has left behind may hold the link open.
            self._closed()
            self.fail(f"it has been silent for {self._silent_s:g} s of host time{where}")
        return turns

    def fail(self, cause: str) -> None:
        """Have done with the mission: kill it, without waiting for its end."""
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
        self._closed_ticks += 1
        ended = self._child.how_it_ended()
        if ended is not None:
            self.fail(f"its process has ended with {ended}")
        elif self._closed_ticks > _CLOSED_TICKS:
            self.fail("its process has closed the link")

    def _check(self, turn: messages.Turn) -> None:
        if not self._answered < turn.tick <= self._sent:
            raise Garbage(f"an answer to tick {turn.tick}, expected: {self._answered + 1} to {self._sent}")
        own = [
            *(ask.robot_id for ask in turn.asks),
            *(each.robot_id for each in turn.failures if each.robot_id is not None),
        ]
        unknown = [robot_id for robot_id in own if robot_id not in self._ports]
        # A task planner beside robots has targets for those of other processes, too.
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
        self._waited_s = 0.0
        self._handler = ""
        for ask in turn.asks:
            self._ask(ask)

    def _ask(self, ask: messages.Ask) -> None:
        if ask.handover != self._handovers[ask.robot_id]:
            # What was asked for before control was lost must not move anything after it has come back.
            self.hear(GoalReport(ask.robot_id, ask.goal_id, "rejected"))
            return
        self._ports[ask.robot_id].put(Request(ask.goal_id, ask.target, ask.upcoming))
