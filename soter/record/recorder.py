"""The run's side of a recording: one object that collects all events and passes on a frame at every tick.

It must not slow the decision path: at a tick it copies some numbers and writes them into a pipe. Another process does
the rest.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import msgspec

from soter.geometry.site import Site
from soter.record import wire
from soter.record.about import Setup, describe, files
from soter.record.content import RecordedWay
from soter.record.looks import LOOK_S, Looks, Stall
from soter.record.messages import EVENTS, DropEvent, Event, TargetEvent, TransitionEvent
from soter.record.pipe import WriterPipe
from soter.record.samples import switch_of
from soter.record.tap import GoalActuator, PeerTap, Tap
from soter.rta import RemotePeer, RobotSupervisor, SwitchRecord
from soter.sdk import Controller, Fleet, RobotState, Truth

logger = logging.getLogger(__name__)

TOGETHER: Final = 8
"""Ticks that are sent to the writer together in virtual time, where one system call for each would cost more than all
the rest. On a wall clock every tick is sent at once."""

TOGETHER_NS: Final = 20_000_000
"""Host time for which the first of them may be held back. A tick is held back only if the next one, if it takes as
long as this one did, comes within this time: slow ticks are sent at once, too."""

LATE_S: Final = 60.0
"""Most that the fleet time of a mission's event may differ from that of the tick at which it is recorded."""

MOST_CHANGES: Final = 1000
"""Most changes of machines that are recorded in one tick, so that a mission cannot flood the file."""

_INDEX: Final = {kind: index for index, kind in enumerate(EVENTS)}


class TargetLog(Protocol):
    """Receives the robots' targets, for statistics; safety does not depend on it."""

    def on_target(self, robot_id: int, target_id: int, place: tuple[float, float]) -> None:
        """A robot has been given a target."""

    def on_ended(self, robot_id: int, target_id: int, outcome: Any) -> None:
        """A target has ended."""


class RecordingReport(NamedTuple):
    """The result of recording a run.

    Attributes:
        failure: why the recording is not complete; empty if it is.
        dropped_ticks: how many ticks are missing in it.
        size_bytes: the file's size.
        refused: number of the mission's messages that were left out, for impossible times or being too many.
    """

    path: Path
    failure: str
    dropped_ticks: int
    size_bytes: int
    refused: int = 0


class Recorder:
    """Records one run. A `Watch` of every supervisor, and a `TargetLog`; a context manager that closes the file.

    Used from the supervisor's thread. No method raises once recording has begun: a run must not end because its disk is
    full.

    For the arguments, see `soter.record.pipe.WriterPipe`.
    """

    def __init__(
        self, path: Path, *, waits: bool, sign: Path | None = None, stop: Callable[[], bool] = lambda: False
    ) -> None:
        self.path: Final = path
        # Foreign code may change the working directory.
        self._file: Final = path.absolute()
        self._stop: Final = stop
        self._sign: Final = sign
        self._refused = self._changes = 0
        self._waits: Final = waits
        self._pipe: WriterPipe | None = None
        self._taps: Final[dict[int, Tap]] = {}
        self._peers: Final[list[PeerTap]] = []
        self._robots: Sequence[tuple[RobotSupervisor, Tap]] = ()
        self._events: list[wire.PendingEvent] = []
        self._ticks: Final[list[wire.TickFrame]] = []
        self._now_s = 0.0
        self._host_ns = 0
        self._log: TargetLog | None = None
        self._looks = Looks()
        self._looked_s = 0.0
        self._lost = (0, 0)
        self._dropped = 0
        self._said = False
        self._last = b""
        self._report: RecordingReport | None = None

    @property
    def writer_pid(self) -> int | None:
        """Process id of the writer; None before it is started."""
        return None if self._pipe is None else self._pipe.pid

    @property
    def writing(self) -> Path:
        """The file that is written; at the end it replaces an existing one."""
        return self.path if self._pipe is None else self._pipe.writing

    # --- before the first tick -------------------------------------------------------------------------------

    def tap(self, robot_id: int, actuator: GoalActuator) -> Tap:
        """Return a tap for a supervisor to use in place of a robot's actuator."""
        tap = self._taps[robot_id] = Tap(robot_id, actuator, self._note)
        return tap

    def tap_peer(self, peer: RemotePeer, robot_ids: Sequence[int]) -> PeerTap:
        """Return a tap for the supervisor of these robots to use in place of a peer of another process."""
        tap = PeerTap(peer, robot_ids)
        self._peers.append(tap)
        return tap

    def begin(
        self,
        setup: Setup,
        fleet: Fleet,
        truth: Truth | None,
        log: TargetLog,
        stalls: Callable[[], Sequence[Stall]] = tuple,
    ) -> None:
        """Start the writer and record what is to be run; call this once, before the first tick.

        Args:
            setup: the run.
            fleet: its robots, with the injected faults.
            truth: ground truth of all rules, those of users' own modules, too; None without it.
            log: called with all events of targets, too.
            stalls: returns the stalls up to now.

        Raises:
            OSError: the file cannot be written.
        """
        robots, workspace, self._log = setup.robots, setup.workspace, log
        self._robots = [(robot, self._taps[robot.robot_id]) for robot in robots]
        self._looks = Looks(robots, truth, fleet.injected, stalls)
        frame = wire.FirstFrame(
            msgspec.json.encode(wire.tamed(describe(setup))),
            files(setup.mission, workspace),
            None if isinstance(workspace, Site) else workspace,
            workspace.plan if isinstance(workspace, Site) else None,
            {robot_id: each.body_radius_m for robot_id, each in setup.capabilities.items()},
            [robot.robot_id for robot in robots],
            {robot.robot_id: [module.name for module in robot.modules] for robot in robots},
        )
        self._pipe = WriterPipe(self._file, waits=self._waits, sign=self._sign, stop=self._stop)
        self._send(self._pipe, wire.packed(frame))
        self._pipe.wait_ready()
        self._say(self._pipe.failure, "; the run goes on")

    # --- called by others ------------------------------------------------------------------------------------

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Record a change of control."""
        self._note(switch_of(record))

    def on_target(self, robot_id: int, target_id: int, place: tuple[float, float]) -> None:
        """Record a robot's target."""
        self._note_target(TargetEvent(self._now_s, robot_id, target_id, float(place[0]), float(place[1])))
        if self._log is not None:
            self._log.on_target(robot_id, target_id, place)

    def on_ended(self, robot_id: int, target_id: int, outcome: Enum) -> None:
        """Record how a target ended."""
        self._note_target(TargetEvent(self._now_s, robot_id, target_id, outcome=str(outcome.value)))
        if self._log is not None:
            self._log.on_ended(robot_id, target_id, outcome)

    def on_transition(self, transition: TransitionEvent) -> None:
        """Record a transition of one of the mission's machines; its time is checked at the tick."""
        self._changes += 1
        if self._changes <= MOST_CHANGES:
            self._note(transition)
            return
        if self._changes == MOST_CHANGES + 1:
            text = "the mission's machines change more than %d times in a tick; the rest is not recorded"
            logger.warning(text, MOST_CHANGES)
        self._refused += 1

    def tick(self, now_s: float, tick: int) -> None:
        """Record one tick; call this when all events of the tick have happened."""
        self._now_s, self._changes = now_s, 0
        pipe = self._pipe
        if pipe is None or pipe.failure:
            self._events = []
            return
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._look(now_s)
        for peer in self._peers:
            self._note(peer.message(now_s))
        rows = [_row(robot, tap) for robot, tap in self._robots]
        self._note_lost()
        self._refuse_times(now_s)
        host_ns, ticks = time.time_ns(), self._ticks
        took_ns, self._host_ns = host_ns - self._host_ns, host_ns
        ticks.append(wire.TickFrame(tick, now_s, host_ns, rows, self._events))  # type: ignore[arg-type]
        self._events = []
        if self._waits and len(ticks) < TOGETHER and host_ns + took_ns - ticks[0].host_ns < TOGETHER_NS:
            return
        sent = self._send(pipe, self._packed_ticks())
        if sent:
            self._lost = (0, 0)
        elif not pipe.failure:
            first, lost = self._lost
            self._lost = (first if lost else tick, lost + 1)
            self._dropped += 1

    def finish(self, result_json: bytes) -> None:
        """Add the result of a run that has ended, by itself or because it was stopped."""
        self._look(self._now_s)
        self._last = self._packed_end(result_json)

    def close(self) -> RecordingReport:
        """Close the file; return the report. Idempotent. On a wall clock, stop the robots first: closing takes time."""
        if self._report is None:
            # Without a result, send at least the events since the last tick.
            last = self._packed_ticks() + (self._last or self._packed_end(b""))
            outcome = wire.WriterOutcome() if self._pipe is None else self._pipe.close(last)
            # A writer that was killed, or had failed before, does not report the size.
            size_bytes = outcome.size_bytes or _size(self.writing)
            # What could be written of it has not replaced what was there before.
            path = self.writing if outcome.failure and self.writing.exists() else self.path
            self._report = RecordingReport(path, outcome.failure, self._dropped, size_bytes, self._refused)
            self._say(outcome.failure, "")
        return self._report

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _note(self, event: Event | RecordedWay) -> None:
        self._events.append((wire.WAY if isinstance(event, RecordedWay) else _INDEX[type(event)], event))

    def _note_target(self, event: TargetEvent) -> None:
        """Record a mission's event of a target, unless no reader could decode it: that would spoil the whole file."""
        try:
            msgspec.json.decode(msgspec.json.encode(event), type=TargetEvent)
        except (msgspec.MsgspecError, ValueError, TypeError, OverflowError):
            self._refused += 1
        else:
            self._note(event)

    def _note_lost(self) -> None:
        first, lost = self._lost
        if lost:
            self._note(DropEvent(self._now_s, first, lost))

    def _refuse_times(self, now_s: float) -> None:
        """Leave out the mission's events at impossible times: files cannot hold them, and plots would scale to them."""
        events = self._events
        kept = [each for each in events if not isinstance(each[1], TransitionEvent) or _near(each[1].time_s, now_s)]
        if len(kept) < len(events):
            if not self._refused:
                logger.warning("the mission tells of changes at impossible times; they are not recorded")
            self._refused += len(events) - len(kept)
            self._events = kept

    def _packed_end(self, result_json: bytes) -> bytes:
        self._note_lost()
        self._refuse_times(self._now_s)
        frame = wire.packed(wire.Finish(self._now_s, result_json, self._events))  # type: ignore[arg-type]
        self._events = []
        return frame

    def _packed_ticks(self) -> bytes:
        """Return the ticks that were not sent yet, as a frame; empty if there are none."""
        if not self._ticks:
            return b""
        frame = wire.packed(wire.Ticks(self._ticks))
        self._ticks.clear()
        return frame

    def _send(self, pipe: WriterPipe, frame: bytes) -> bool:
        if pipe.send(frame):
            return True
        if pipe.failure:
            self._say(pipe.failure, "; the run goes on")
        elif not self._dropped:
            logger.warning("the recording's writer does not follow: ticks from %.2f s on are not recorded", self._now_s)
        return False

    def _say(self, failure: str, consequence: str) -> None:
        if failure and not self._said:
            self._said = True
            logger.error("the recording %s is not complete: %s%s", self.path, failure, consequence)

    def _look(self, now_s: float) -> None:
        for event in self._looks.look(now_s):
            self._note(event)


def _near(time_s: object, now_s: float) -> bool:
    # Compared, not subtracted: an int may be too large for a float.
    return isinstance(time_s, int | float) and now_s - LATE_S <= time_s <= now_s + LATE_S


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _row(robot: RobotSupervisor, tap: Tap) -> wire.RobotRow:
    sample, driver = robot.situation.own, robot.driver
    assert isinstance(sample, RobotState)
    in_sc, bit = 0, 1
    numbers = []
    for module in robot.modules:
        numbers.append(module.margin)
        numbers.append(module.reach)
        if module.mode is Controller.SC:
            in_sc |= bit
        bit <<= 1
    row = wire.RobotRow(sample, -1 if driver is None else driver.rank, robot.mode is Controller.SC, in_sc, numbers)
    if tap.unread or tap.refused or tap.ac_drove or robot.ac_failure:
        row.unread, row.no_state, row.refused = tap.unread, tap.no_state, tuple(tap.refused)
        row.ac_drove, row.ac_failure = tap.ac_drove, robot.ac_failure
        tap.unread, tap.no_state, tap.ac_drove = False, "", False
        tap.refused.clear()
    return row
