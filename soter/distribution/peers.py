"""The state of another process as heard here: its robots' samples with their largest ages, and what it has heard.

No two clocks are compared. A process repeats the sending time of the latest status it heard, with how long ago it came.
If a process gets its own sending time `e` back, held for `h`, the message was sent no earlier than `e + h`; a sample
that was `a` old by then was taken no earlier than `e + h - a`, all on the receiver's clock. So the resulting age is
never too small, and too large by at most a round trip.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec

from soter.distribution.status import Echo, RobotStatus, Status
from soter.isolation.watched_port import WatchedPort
from soter.rta import Assumption, PeerMonitor, ReachModel
from soter.rta.monitors import BrokenAssumption
from soter.sdk import RobotState

DRIFT: Final = 1e-3
"""Largest relative difference in rate between two processes' clocks. Fleet clocks follow quartz clocks, and may be off
by 2e-4 each; the rest is slack. Echoes are sent for at most two seconds, so that they are off by at most 2 ms."""

RECENT_S: Final = 2.0
"""How long a start of a process gets echoes after it was heard; older ones are of no use to it."""

_ROUNDING_S: Final = 1e-6
_MOST_STARTS: Final = 4
_REMEMBERED: Final = 256
"""How many of this process's statuses are kept until their echoes come back: more than ten seconds of ticks."""


class _Offset:
    """The offset of this process's clock from another's, which every round trip bounds from both sides.

    It changes no faster than clocks may drift. If two bounds contradict each other, one of the clocks has jumped.
    """

    __slots__ = ("_known_s", "_least_s", "_most_s")

    def __init__(self) -> None:
        self._known_s = 0.0
        self._least_s, self._most_s = -math.inf, math.inf

    def contradiction_s(self, now_s: float, least_s: float, most_s: float) -> float:
        """Take the bounds of one more round trip; return by how much they contradict the earlier ones, or 0."""
        slack_s = DRIFT * (now_s - self._known_s)
        before_s = self._least_s - slack_s, self._most_s + slack_s
        wrong_s = max(before_s[0] - most_s, least_s - before_s[1])
        self._known_s = now_s
        if wrong_s > _ROUNDING_S:
            self._least_s, self._most_s = least_s, most_s
            return wrong_s
        self._least_s, self._most_s = max(before_s[0], least_s), min(before_s[1], most_s)
        return 0.0


@dataclass
class _Start:
    """One start of the other process.

    Attributes:
        status: its latest status.
        received_s: when that was received, on this process's clock.
        sent_s: when that was sent at the earliest, on this process's clock; minus infinity before the other process has
            heard this one.
        heard: by robot id, the stamps of this process's samples that the other has heard last.
        offset: the bounds of its clock.
        was_current: whether it has been taken for the live start before.
    """

    status: Status
    received_s: float
    sent_s: float = -math.inf
    heard: Mapping[int, float] = field(default_factory=dict)
    offset: _Offset = field(default_factory=_Offset)
    was_current: bool = False


class RemoteRobot:
    """A robot of another process; a `soter.rta.RemotePeer`. Supervisor's thread only.

    Attributes:
        port: shows the robot to planners.
    """

    def __init__(self, robot_id: int, process: OtherProcess, monitor: PeerMonitor) -> None:
        self.robot_id = robot_id
        self.port: Final = WatchedPort(robot_id)
        self._process: Final = process
        self._monitor: Final = monitor
        self._latest: RobotStatus | None = None
        self._reported: RobotState | None = None
        self._at_least_s = -math.inf
        self._found: BrokenAssumption | None = None

    def sample(self) -> RobotState | None:
        """Return the latest sample, its stamp on this process's clock and never too late; None before the first."""
        return None if self._latest is None else self._latest.state

    def heard_of(self, robot_id: int) -> float:
        """Return the stamp of this process's robot's latest sample that the other process is known to have heard."""
        return self._process.heard_of(robot_id)

    def needs_charge(self) -> bool:
        """Return whether the robot is on its way to charge, with a low charge."""
        return self._latest is not None and self._latest.needs_charge

    @property
    def driver(self) -> str:
        """The module that drives the robot; empty for its AC, and before it was heard."""
        return "" if self._latest is None else self._latest.driver

    def found(self) -> BrokenAssumption | None:
        """Return and forget the latest broken assumption about the robot's samples; None without one."""
        found, self._found = self._found, None
        return found

    def distrust(self, cause: str) -> None:
        """Note that the stamps of the robot's samples cannot be right."""
        self._found = BrokenAssumption(Assumption.CLOCK, f"robot {self.robot_id}: {cause}")

    def take(self, status: RobotStatus, stamp_s: float, *, anew: bool) -> None:
        """Take the robot's part of a status.

        Args:
            status: the robot's status.
            stamp_s: when the sample was taken at the earliest, on this process's clock.
            anew: whether the other process, and its clock, have restarted.
        """
        reported, before = status.state, self._latest
        last, self._reported = (None if anew else self._reported), reported
        if last is not None and reported.stamp_s < last.stamp_s:
            back_s = last.stamp_s - reported.stamp_s
            self.distrust(f"stamps went back by {back_s:.3f} s")
            self._reported = last
            return
        if last is None or reported.stamp_s > last.stamp_s:
            # With the stamps of the robot's own process: those on this clock are bounds, and do not give the time
            # between two samples.
            found = self._monitor.look(reported.stamp_s, [reported])
            if last is not None:
                self._found = found.get(self.robot_id, self._found)
        # The bound of an earlier sample holds for a later one too. Only stamps of one start tell which is later: two
        # processes with one name may be taken for the live one in turn.
        self._at_least_s = stamp_s if anew else max(stamp_s, self._at_least_s)
        if before is not None and self._at_least_s < before.state.stamp_s:
            return
        state = reported._replace(stamp_s=self._at_least_s)
        self._latest = msgspec.structs.replace(status, state=state)
        self.port.state = state
        self.port.engaged = status.engaged


class OtherProcess:
    """One other process, by its statuses. Supervisor's thread only.

    Args:
        robots: the robots that it supervises by the mission file, with the promised reach model and position noise of
            each.
        me: this process's name.
        epoch: this process's start.
        mission: this process's mission.

    Attributes:
        robots: its robots, by id.
        starts: how many of its starts have been heard; more than 1 after a restart.
        foreign: its mission if that is not ours; empty otherwise.
        strangers: how many statuses were ignored because they name robots of no or another process.
    """

    def __init__(
        self, name: str, robots: Mapping[int, tuple[ReachModel, float]], me: str, epoch: int, mission: str
    ) -> None:
        self.name: Final = name
        self.robots: Final = {
            robot_id: RemoteRobot(robot_id, self, PeerMonitor({robot_id: (model, noise_m)}, math.inf))
            for robot_id, (model, noise_m) in robots.items()
        }
        self.starts = 0
        self.foreign = ""
        self.strangers = 0
        self._me: Final = me
        self._epoch: Final = epoch
        self._mission: Final = mission
        self._starts: Final[dict[int, _Start]] = {}
        self._current = 0
        self._sent: Final[deque[tuple[float, Mapping[int, float]]]] = deque(maxlen=_REMEMBERED)

    @property
    def heard_s(self) -> float:
        """Earliest possible sending time of its latest status; minus infinity before it has heard this process."""
        start = self._starts.get(self._current)
        return -math.inf if start is None else start.sent_s

    @property
    def has_heard_us(self) -> bool:
        """Whether it has reported that it hears this process."""
        return self._current != 0

    @property
    def heard_at_all(self) -> bool:
        """Whether it was ever heard."""
        return bool(self._starts)

    def note(self, sent_s: float, stamps: Mapping[int, float]) -> None:
        """Remember a status of this process: its sending time, and the stamps of its robots' samples, by id."""
        self._sent.append((sent_s, stamps))

    def heard_of(self, robot_id: int) -> float:
        """Return the stamp of the latest sample of this process's robot that the other has reported to have heard."""
        start = self._starts.get(self._current)
        return -math.inf if start is None else start.heard.get(robot_id, -math.inf)

    def take(self, status: Status, received_s: float) -> None:
        """Take a status with its time of arrival on this process's clock; late and double ones are ignored."""
        if status.mission != self._mission:
            self.foreign = status.mission
            return
        if {robot.state.robot_id for robot in status.robots} - self.robots.keys():
            self.strangers += 1
            return
        start = self._starts.get(status.epoch)
        if start is None:
            start = self._starts[status.epoch] = _Start(status, received_s)
        elif status.serial <= start.status.serial:
            return
        self.foreign = ""
        start.status, start.received_s = status, received_s
        echo = next((echo for echo in status.echoes if (echo.process, echo.epoch) == (self._me, self._epoch)), None)
        if echo is not None and echo.sent_s <= received_s:
            self._hear_echo(start, echo)
        self._forget()

    def echoes(self, now_s: float) -> list[Echo]:
        """Return the echoes to send to it now."""
        return [
            Echo(self.name, epoch, start.status.sent_s, max(0.0, now_s - start.received_s))
            for epoch, start in self._starts.items()
            if now_s - start.received_s < RECENT_S
        ]

    def _hear_echo(self, start: _Start, echo: Echo) -> None:
        status = start.status
        sent_s = min(echo.sent_s + echo.held_s * (1.0 - DRIFT), start.received_s)
        start.sent_s = max(start.sent_s, sent_s)
        wrong_s = start.offset.contradiction_s(
            start.received_s, start.sent_s - status.sent_s, start.received_s - status.sent_s
        )
        for told_s, stamps in reversed(self._sent):
            if told_s == echo.sent_s:
                start.heard = stamps
                break
        current = self._starts.get(self._current)
        anew = current is not start
        # A late status of a start that has ended must not replace the live start.
        if anew and current is not None and current.sent_s >= start.sent_s:
            return
        if anew:
            self.starts += not start.was_current
            start.was_current, self._current = True, status.epoch
        for robot in status.robots:
            age_s = max(0.0, status.sent_s - robot.state.stamp_s) * (1.0 + DRIFT)
            self.robots[robot.state.robot_id].take(robot, start.sent_s - age_s, anew=anew)
            if wrong_s:
                self.robots[robot.state.robot_id].distrust(
                    f"its clock, that of process '{self.name}', went apart by {wrong_s:.4f} s more than clocks do"
                )

    def _forget(self) -> None:
        if len(self._starts) <= _MOST_STARTS:
            return
        oldest = min(
            (epoch for epoch in self._starts if epoch != self._current), key=lambda e: self._starts[e].received_s
        )
        del self._starts[oldest]
