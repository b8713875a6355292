"""The process that writes a recording: takes frames from a run and turns them into messages.

The process has a session of its own and ignores signals, so that it can write the remaining data, however the run ends.
It ends when the run closes its end of the pipe.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final

import msgspec
from msgspec import Raw

from soter.geometry.site import Site
from soter.record import foxglove, messages, wire
from soter.record.attachments import ABOUT_JSON, RESULT_JSON, About
from soter.record.check import seal
from soter.record.content import RecordedWay
from soter.record.digest import Sign
from soter.record.file import RecordingFile
from soter.record.messages import AC, SC
from soter.record.samples import state_of

CHUNK_S: Final = 0.5
"""Longest host time until a chunk is closed; an open chunk is lost if this process is killed."""

BUSY_CHUNK_S: Final = 0.2
"""The same in virtual time: less, since this process may be late with so much to write."""

LOOK_S: Final = 0.02
"""How often the pipe is emptied. This process does not wait on the pipe: to wake it up at every tick would cost the
run a slow system call."""

PICTURE_S: Final = 0.1
"""Fleet time between two sets of frames for viewers."""

READY: Final = b"\n"
"""Sent to the run when the description of the run is in the file."""

NICENESS: Final = 5
_READ_BYTES: Final = 1 << 20
_MEDIA_TYPES: Final = {".json": "application/json", ".toml": "application/toml", ".xml": "application/xml"}


class Scribe:
    """Turns frames into messages.

    Attributes:
        complete: whether the run has sent its last frame.
    """

    def __init__(self, file: RecordingFile) -> None:
        self._file: Final = file
        self._begin: wire.FirstFrame | None = None
        self._decoders: Final = [msgspec.msgpack.Decoder(kind) for kind in messages.EVENTS]
        self._ways: Final = msgspec.msgpack.Decoder(RecordedWay)
        self._picture_s = 0.0
        self._by_ac: dict[int, bool] = {}
        self._spells: dict[tuple[int, str], float] = {}
        self._host_ns = time.time_ns()
        self.complete = False

    def take(self, frame: wire.Frame) -> None:
        """Write the messages of a frame."""
        if isinstance(frame, wire.FirstFrame):
            self._start(frame)
        elif isinstance(frame, wire.Ticks):
            for tick in frame.ticks:
                self._host_ns = tick.host_ns
                self._note(tick.events)
                self._tick(tick)
        else:
            self._note(frame.events)
            self.complete = bool(frame.result)
            if frame.result:
                self._file.attach(RESULT_JSON, frame.result, _MEDIA_TYPES[".json"])

    def _start(self, begin: wire.FirstFrame) -> None:
        self._begin = begin
        about = msgspec.json.decode(begin.about, type=About)
        versions = {f"version of {name}": text for name, text in about.versions.items()}
        self._file.describe("soter", {
            "mission": about.source, "backend": about.backend, "seed": str(about.seed), "started": about.started_utc,
            "robots": str(len(about.robots)), "modules": ", ".join(about.modules), **versions,
        })  # fmt: skip
        for name, data in {ABOUT_JSON: begin.about, **begin.files}.items():
            self._file.attach(name, data, _MEDIA_TYPES[name[name.rindex(".") :]])
        workspace = begin.workspace if begin.site is None else Site(begin.site)
        assert workspace is not None
        self._file.write(foxglove.SCENE_TOPIC, foxglove.workspace_scene(workspace), 0, self._host_ns)
        self._file.flush()

    def _tick(self, tick: wire.TickFrame) -> None:
        begin = self._begin
        if begin is None:
            return
        time_ns = foxglove.nanoseconds(tick.time_s)
        topic = messages.TOPICS[messages.RobotTick]
        for robot_id, row in zip(begin.robots, tick.rows, strict=True):
            record = _record(tick, robot_id, row, begin.modules[robot_id])
            record.check = seal(record)
            self._file.write(topic.format(robot_id=robot_id), record, time_ns, tick.host_ns)
        if tick.time_s >= self._picture_s:
            self._picture_s = tick.time_s + PICTURE_S - 1e-9
            self._picture(begin, tick, time_ns)

    def _picture(self, begin: wire.FirstFrame, tick: wire.TickFrame, time_ns: int) -> None:
        now = foxglove.FoxgloveTime.of(tick.time_s)
        transforms = [
            foxglove.transform(now, robot_id, row.state.x_m, row.state.y_m, row.state.z_m, row.state.heading_rad)
            for robot_id, row in zip(begin.robots, tick.rows, strict=True)
        ]
        self._file.write(foxglove.TRANSFORMS_TOPIC, foxglove.FrameTransforms(transforms), time_ns, tick.host_ns)
        for robot_id, row in zip(begin.robots, tick.rows, strict=True):
            if self._by_ac.get(robot_id) is row.in_sc or robot_id not in self._by_ac:
                self._by_ac[robot_id] = not row.in_sc
                scene = foxglove.robot_scene(now, robot_id, begin.radii_m[robot_id], not row.in_sc)
                self._file.write(foxglove.ROBOT_TOPIC.format(robot_id=robot_id), scene, time_ns, tick.host_ns)

    def _note(self, events: Sequence[tuple[int, Raw]]) -> None:
        for index, raw in events:
            self._event(index, raw)

    def _event(self, index: int, raw: Raw) -> None:
        if index == wire.WAY:
            way = self._ways.decode(raw)
            topic = foxglove.WAY_TOPIC.format(robot_id=way.robot_id)
            message = foxglove.way(foxglove.FoxgloveTime.of(way.time_s), way.places)
            self._file.write(topic, message, foxglove.nanoseconds(way.time_s), self._host_ns)
            return
        event = self._decoders[index].decode(raw)
        if isinstance(event, messages.PeerEvent):
            event.check = seal(event)
        topic = messages.TOPICS[type(event)]
        if isinstance(event, messages.GoalEvent):
            topic = topic.format(robot_id=event.robot_id)
        time_ns = foxglove.nanoseconds(event.time_s)
        self._file.write(topic, event, time_ns, self._host_ns)
        line = None if self._is_told(event) else _line(event)
        if line is not None:
            level, name, text = line
            log = foxglove.Log(foxglove.FoxgloveTime.of(event.time_s), level, text, name)
            self._file.write(foxglove.LOG_TOPIC, log, time_ns, self._host_ns)

    def _is_told(self, event: messages.Event) -> bool:
        """Return whether an event was logged before: of a failed assumption, only the start of each spell is logged."""
        if not isinstance(event, messages.BreachEvent):
            return False
        key = (event.robot_id, event.assumption)
        before, self._spells[key] = self._spells.get(key), event.start_s
        return before == event.start_s


def _record(tick: wire.TickFrame, robot_id: int, row: wire.RobotRow, names: Sequence[str]) -> messages.RobotTick:
    numbers, in_sc = row.numbers, row.modules_in_sc
    modules = tuple(
        messages.ModuleTick.of(name, SC if in_sc >> index & 1 else AC, numbers[2 * index], numbers[2 * index + 1])
        for index, name in enumerate(names)
    )
    return messages.RobotTick(
        tick.tick, tick.time_s, robot_id, SC if row.in_sc else AC, AC if row.driver < 0 else names[row.driver],
        state_of(row.state), modules, row.unread, row.no_state, tuple(messages.Refusal(*each) for each in row.refused),
        row.ac_drove, row.ac_failure,
    )  # fmt: skip


def _line(event: messages.Event) -> tuple[int, str, str] | None:
    """Return the log line of an event: level, source, text; None for events that are too frequent for a log."""
    if isinstance(event, messages.SwitchEvent):
        who = foxglove.robot_frame(event.robot_id)
        if event.after == AC:
            return foxglove.INFO, who, f"AC in control again, released by {event.module}"
        text = f"{event.before} -> {event.after}: {event.module}: {event.cause}"
        return foxglove.WARNING if event.before == AC else foxglove.INFO, who, text
    if isinstance(event, messages.TargetEvent):
        text = f"target {event.target_id}: {event.outcome}" if event.outcome else f"target {event.target_id}"
        return foxglove.INFO, foxglove.robot_frame(event.robot_id), text
    if isinstance(event, messages.ViolationEvent):
        who = ", ".join(map(foxglove.robot_frame, event.robots))
        return foxglove.ERROR, who, f"{event.rule} broken since {event.start_s:.2f} s"
    if isinstance(event, messages.BreachEvent):
        text = f"assumption {event.assumption} failed at {event.start_s:.2f} s: {event.cause}"
        return foxglove.WARNING, foxglove.robot_frame(event.robot_id), text
    if isinstance(event, messages.StallEvent):
        since = f"without its AC since {event.start_s:.2f} s: {event.module}: {event.cause}"
        text = since if event.end_s is msgspec.UNSET else f"no longer {since}"
        return foxglove.WARNING, foxglove.robot_frame(event.robot_id), text
    if isinstance(event, messages.FaultEvent):
        return foxglove.WARNING, foxglove.robot_frame(event.robot_id), f"fault {event.kind}: {event.affected} so far"
    if isinstance(event, messages.DropEvent):
        return foxglove.ERROR, "recording", f"{event.ticks} ticks from {event.first_tick} on were not recorded"
    return None


def record(
    source_fd: int, stream: IO[bytes], capacity_bytes: int, chunk_s: float, sign: Sign | None = None, key: bytes = b""
) -> bool:
    """Write all frames from a pipe, until its other end is closed; return whether the run came to its end.

    The pipe has a capacity of `capacity_bytes`, and a chunk is closed after `chunk_s` of host time. For `sign` and
    `key`, see `RecordingFile`.

    Raises:
        OSError: the file cannot be written.
    """
    file = RecordingFile(stream, sign, key)
    scribe, intake = Scribe(file), wire.FrameReader()
    os.set_blocking(source_fd, False)
    flushed_s = time.monotonic()
    while True:
        try:
            data = os.read(source_fd, _READ_BYTES)
        except BlockingIOError:
            data = None
        if data is not None:
            if not data:
                break
            for frame in intake.take(data):
                scribe.take(frame)
                if isinstance(frame, wire.FirstFrame):
                    # If the run was killed meanwhile, its file must be closed all the same.
                    with contextlib.suppress(BrokenPipeError):
                        os.write(sys.stdout.fileno(), READY)
                flushed_s = _flushed(file, flushed_s, chunk_s)
        flushed_s = _flushed(file, flushed_s, chunk_s)
        # A run that has filled much of the pipe in this time is about to wait for the writer.
        if data is None or len(data) < capacity_bytes // 4:
            time.sleep(LOOK_S)
    file.finish()
    return scribe.complete


def _flushed(file: RecordingFile, flushed_s: float, chunk_s: float) -> float:
    """Close the chunk if it is due; return when a chunk was last closed."""
    now_s = time.monotonic()
    if now_s - flushed_s < chunk_s:
        return flushed_s
    file.flush()
    return now_s


def _signing(path: str | None) -> tuple[Sign | None, bytes]:
    """Return the function that signs, and the public key that verifies its signatures."""
    if path is None:
        return None, b""
    from soter.record.signing import read_private_key

    key = read_private_key(Path(path), "--sign")
    return key.sign, key.public_key().public_bytes_raw()


def main() -> None:
    """Write a recording; arguments: the file's descriptor, the pipe's capacity, and a `Task`."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    file_fd, capacity_bytes = int(sys.argv[1]), int(sys.argv[2])
    task = msgspec.json.decode(sys.argv[3], type=wire.Task)
    if task.nice:
        with contextlib.suppress(OSError):
            os.nice(NICENESS)
    outcome = wire.WriterOutcome()
    stream = os.fdopen(file_fd, "wb")
    try:
        complete = record(
            sys.stdin.fileno(), stream, capacity_bytes, CHUNK_S if task.nice else BUSY_CHUNK_S, *_signing(task.sign)
        )
        if complete and task.target is not None:
            Path(task.part).replace(task.target)
    except OSError as failure:
        outcome.failure = failure.strerror or str(failure)
    except Exception as failure:  # noqa: BLE001 - whatever it is, the run is told before this process ends
        outcome.failure = repr(failure)
    with contextlib.suppress(OSError):
        outcome.size_bytes = os.fstat(file_fd).st_size
    # Sent before the pipe is closed, so that a run that cannot send any more learns at once why.
    os.write(sys.stdout.fileno(), msgspec.json.encode(outcome))
    # If the disk is full, the rest of the stream's buffer cannot be written at exit either.
    os._exit(0)


if __name__ == "__main__":
    main()
