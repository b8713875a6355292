"""Another process as this one hears it: its robots' samples, how old they are at most, and what it has heard itself.

No two clocks are compared. A process repeats what it heard last, and for how long it has had it. Who hears its own
sending time `e` come back after having been held for `h` knows that the message was sent no earlier than `e + h`, and
that a sample which was `a` old by then was taken no earlier than `e + h - a`, all on its own clock. So the age that
follows is never too small, and too large by a round trip at most.
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
"""By which part two processes' clocks may go at different rates. Clocks of fleets follow crystals, and may be off by
2e-4 each; the rest is slack. What is held is told for two seconds at most, which makes it two milliseconds at most."""

RECENT_S: Final = 2.0
"""A start of a process that was heard within this time is told so; what is older is of no use to it."""

_ROUNDING_S: Final = 1e-6
_MOST_STARTS: Final = 4
_REMEMBERED: Final = 256
"""Statuses of this process whose samples are remembered until they come back: more than ten seconds of ticks."""


class _Offset:
    """By how much this process's clock is ahead of another's: every round trip bounds it from both sides.

    It changes no faster than clocks may drift. Where two bounds contradict each other, one of the clocks did otherwise.
    """

    __slots__ = ("_known_s", "_least_s", "_most_s")

    def __init__(self) -> None:
        self._known_s = 0.0
        self._least_s, self._most_s = -math.inf, math.inf

    def contradiction_s(self, now_s: float, least_s: float, most_s: float) -> float:
        """Take the bounds of one more round trip; return by how much they contradict those before, 0 if they do not."""
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
    """One start of the other process, as it was heard last.

    Attributes:
        status: its latest.
        received_s: when that was received, on this process's clock.
        sent_s: when it was sent at the earliest, on this process's clock; minus infinity before it has heard of this
            process.
        heard: the stamps of this process's samples that it has heard last, by robot.
        offset: what is known of its clock.
        was_current: whether it has been believed to be the one that lives.
    """

    status: Status
    received_s: float
    sent_s: float = -math.inf
    heard: Mapping[int, float] = field(default_factory=dict)
    offset: _Offset = field(default_factory=_Offset)
    was_current: bool = False


class RemoteRobot:
    """A robot of another process; a `soter.rta.RemotePeer`. Belongs to the supervisor's thread.

    Attributes:
        port: what planners are shown of it.
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
        """Return the stamp of the latest sample of this process's robot that the other is known to have heard."""
        return self._process.heard_of(robot_id)

    def needs_charge(self) -> bool:
        """Return whether it is on its way to charge, and low."""
        return self._latest is not None and self._latest.needs_charge

    @property
    def driver(self) -> str:
        """The module that drives it; empty for its AC, and before it was heard."""
        return "" if self._latest is None else self._latest.driver

    def found(self) -> BrokenAssumption | None:
        """Return what is wrong with what was reported of it, and forget it."""
        found, self._found = self._found, None
        return found

    def distrust(self, cause: str) -> None:
        """Note that the stamps of its samples cannot be right."""
        self._found = BrokenAssumption(Assumption.CLOCK, f"robot {self.robot_id}: {cause}")

    def take(self, status: RobotStatus, stamp_s: float, *, anew: bool) -> None:
        """Take what a status says of it.

        Args:
            status: what it says.
            stamp_s: when the sample was taken at the earliest, on this process's clock.
            anew: the other process has started anew, and so has its clock.
        """
        reported, before = status.state, self._latest
        last, self._reported = (None if anew else self._reported), reported
        if last is not None and reported.stamp_s < last.stamp_s:
            back_s = last.stamp_s - reported.stamp_s
            self.distrust(f"stamps went back by {back_s:.3f} s")
            self._reported = last
            return
        if last is None or reported.stamp_s > last.stamp_s:
            # With the stamps that it was given where it was taken: those on this clock are bounds, which say nothing
            # about the time between two samples.
            found = self._monitor.look(reported.stamp_s, [reported])
            if last is not None:
                self._found = found.get(self.robot_id, self._found)
        # A later sample was not taken earlier: what is known of the one before holds for it too. Which is later, only
        # stamps of one start say: of two processes with one name each may be believed in turn.
        self._at_least_s = stamp_s if anew else max(stamp_s, self._at_least_s)
        if before is not None and self._at_least_s < before.state.stamp_s:
            return
        state = reported._replace(stamp_s=self._at_least_s)
        self._latest = msgspec.structs.replace(status, state=state)
        self.port.state = state
        self.port.engaged = status.engaged


class OtherProcess:
    """Everything that is heard of one other process. One thread: the supervisor's.

    Args:
        name: which process.
        robots: the robots that it supervises, by the mission file, with the reach model and the position noise that
            are promised for each.
        me: this process's name.
        epoch: of this start.
        mission: what this process runs.

    Attributes:
        robots: by id.
        starts: how many starts of it have been heard; more than 1 when it was restarted.
        foreign: the mission that it runs if that is another; empty otherwise.
        strangers: statuses that were ignored, because they concern robots that are not the other's.
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
        """When it was last heard, and known not to come late; minus infinity before it has heard of this process."""
        start = self._starts.get(self._current)
        return -math.inf if start is None else start.sent_s

    @property
    def has_heard_us(self) -> bool:
        """Whether it has said that it hears this process."""
        return self._current != 0

    @property
    def heard_at_all(self) -> bool:
        """Whether anything of it was ever heard."""
        return bool(self._starts)

    def note(self, sent_s: float, stamps: Mapping[int, float]) -> None:
        """Remember what this process has told: the stamps of its robots' samples, by robot."""
        self._sent.append((sent_s, stamps))

    def heard_of(self, robot_id: int) -> float:
        """Return the stamp of the latest sample of a robot of this process that the other has said it heard."""
        start = self._starts.get(self._current)
        return -math.inf if start is None else start.heard.get(robot_id, -math.inf)

    def take(self, status: Status, received_s: float) -> None:
        """Take a status that was received at a time of this process's clock; what comes late or twice is ignored."""
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
        """Return what to tell it of itself, now."""
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
        # A late word of a start that has ended must not silence the one that lives.
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
