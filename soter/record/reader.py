"""Reads recordings, whole or cut off: as a stream, and as arrays for drawing."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeVar

import msgspec
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, Header, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from msgspec import UNSET, Struct
from zstandard import ZstdError

from soter.errors import ConfigError, meant
from soter.geometry.site import Site, SitePlan
from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import parse_workspace
from soter.record import foxglove, messages
from soter.record.attachments import ABOUT_JSON, RESULT_JSON, SITE_JSON, WORKSPACE_XML, About, Result
from soter.record.content import Content, RecordedTick, RecordedWay
from soter.record.digest import DigestState, Proof, opened, prove
from soter.record.file import PROFILE
from soter.record.messages import AC, EVENTS, Event, RobotTick
from soter.record.tracks import RunTracks
from soter.record.unpack import Unpacker
from soter.rta import SwitchRecord
from soter.sdk import Violation

MAX_RECORD_BYTES: Final = 1 << 26
MAX_ATTACHED_BYTES: Final = 1 << 27
"""Largest size of all attachments together."""

_DAMAGE: Final = (McapError, ZstdError, struct.error, ValueError, TypeError, OverflowError, MemoryError)
"""The errors that readers of MCAP raise for a bad file; for texts that are not UTF-8 it is ValueError."""

_DRAWN_TICKS: Final = 5
"""Every how many ticks of a track are drawn in a picture."""

_TICK: Final = messages.schema_name(RobotTick)
_EVENTS: Final = {messages.schema_name(kind): msgspec.json.Decoder(kind) for kind in EVENTS}

M = TypeVar("M", bound=Struct)


class BadRecording(ConfigError):
    """A file is no recording, or a damaged one. A recording that was only cut off is read as far as it goes."""


class Recording:
    """A recording in a file. The description of its run is read at once; the rest is streamed, any number of times.

    Attributes:
        about: the run, its robots and their modules.
        attachments: the mission file, the workspace file and others, by name, as far as they were read.
        proof: the result of checking its digest; None while it is being written.

    Raises:
        BadRecording: the file is no recording, was changed after it was written, or ends before the description.
    """

    def __init__(self, path: Path) -> None:
        self.path: Final = path
        self.attachments: Final[dict[str, bytes]] = {}
        self._truncated: bool | None = None
        for _ in self._records(head_only=True):
            pass
        self.proof: Final = self._prove()
        if self.proof is not None and self.proof.state is DigestState.CHANGED:
            raise BadRecording(f"{path}: it was damaged or changed after it was written: {self.proof.why}")
        about = self.attachments.get(ABOUT_JSON)
        if about is None:
            raise BadRecording(f"{path}: it does not say what was run; it was cut off, or SOTER did not record it")
        self.about: Final = self._decoded(about, About, ABOUT_JSON)
        self._robot_ids: Final = frozenset(robot.robot_id for robot in self.about.robots)
        self._modules: Final = {
            robot.robot_id: tuple(module.name for module in robot.modules) for robot in self.about.robots
        }
        self._all_ids: Final = self._robot_ids.union(peer.robot_id for peer in self.about.peers)
        self._drivers: Final = frozenset((AC, *self.about.modules))
        if self.about.version > messages.VERSION:
            raise BadRecording(
                f"{path}: its messages are of version {self.about.version}, known is {messages.VERSION}; "
                "a newer version of SOTER can read it"
            )

    # --- as a stream ---------------------------------------------------------------------------------------

    @property
    def truncated(self) -> bool:
        """Whether the file was not closed: its run was killed, or the disk was full. Reads the file to find out."""
        if self._truncated is None:
            for _ in self._records():
                pass
        return bool(self._truncated)

    def messages(self) -> Iterator[tuple[int, RobotTick | Event]]:
        """Yield every message of SOTER's own, in order, each with the host's time of day in nanoseconds.

        Raises:
            BadRecording: a part of the file is damaged or invalid.
        """
        for host_ns, message in self._messages():
            if not isinstance(message, RecordedWay):
                yield host_ns, message

    def ticks(self) -> Iterator[RecordedTick]:
        """Yield every tick that has all robots; the last one of a file that was cut off may lack some, and is left out.

        Events after the last tick come with a tick without robots.

        Raises:
            BadRecording: see `messages`.
        """
        count = len(self._robot_ids)
        events: list[Event] = []
        ways: list[RecordedWay] = []
        robots: dict[int, RobotTick] = {}
        last: RecordedTick | None = None
        for host_ns, message in self._messages():
            if isinstance(message, RecordedWay):
                ways.append(message)
                continue
            self._check_names(message)
            if not isinstance(message, RobotTick):
                events.append(message)
                continue
            if robots and next(iter(robots.values())).tick != message.tick:
                raise BadRecording(f"{self.path}: the tick before {message.time_s:.3f} s lacks a robot")
            robots[message.robot_id] = message
            if len(robots) == count:
                last = RecordedTick(message.tick, message.time_s, host_ns, robots, tuple(events), tuple(ways))
                yield last
                robots, events, ways = {}, [], []
        if (events or ways) and last is not None:
            yield RecordedTick(last.tick, last.time_s, last.host_ns, {}, tuple(events), tuple(ways))

    def _check_names(self, message: RobotTick | Event) -> None:
        """Raise an error if a message names a robot or a module that did not take part."""
        robot_ids = self._robot_ids
        drivers: tuple[str, ...] = ()
        if isinstance(message, RobotTick):
            drivers = (message.driver,)
            if (
                message.robot_id in robot_ids
                and tuple(each.name for each in message.modules) != self._modules[message.robot_id]
            ):
                raise BadRecording(f"{self.path}: a tick at {message.time_s:.3f} s has not the modules of its robot")
        elif isinstance(message, messages.SwitchEvent):
            drivers = (message.before, message.after)
        elif isinstance(message, messages.TargetEvent):
            # The process with the task planner also records the targets of other processes' robots.
            robot_ids = self._all_ids
            if not message.outcome and UNSET in (message.x_m, message.y_m):
                raise BadRecording(f"{self.path}: a target that begins at {message.time_s:.3f} s has no place")
        elif not isinstance(message, messages.GoalEvent | messages.BreachEvent | messages.StallEvent):
            return
        if message.robot_id not in robot_ids or not self._drivers.issuperset(drivers):
            raise BadRecording(
                f"{self.path}: a message at {message.time_s:.3f} s names what did not take part: "
                f"robot {', '.join(map(str, (message.robot_id, *drivers)))}"
            )

    # --- as a whole ----------------------------------------------------------------------------------------

    @property
    def result_json(self) -> bytes | None:
        """The result of the run, as `soter run --json` writes it; None if the run did not come to an end."""
        return None if self.truncated else self.attachments.get(RESULT_JSON)

    @property
    def result(self) -> Result | None:
        """The parts of the result that readers use; None if the run did not come to an end."""
        data = self.result_json
        return None if data is None else self._decoded(data, Result, RESULT_JSON)

    def workspace(self) -> Workspace:
        """Return the workspace of the run, with the robots that took part, those of other processes too.

        Raises:
            BadRecording: the recording lacks the workspace, or it has other robots.
            ConfigError: the workspace is not allowed.
        """
        workspace = self._read_workspace().with_robots(len(self._all_ids))
        if self._all_ids != {place.id for place in workspace.robots}:
            robots = ", ".join(map(str, sorted(self._all_ids)))
            raise BadRecording(f"{self.path}: its robots are {robots}, which are not those of its workspace file")
        return workspace

    def _read_workspace(self) -> Workspace:
        if (made_of := self.attachments.get(SITE_JSON)) is not None:
            site = Site(self._decoded(made_of, SitePlan, SITE_JSON))
            try:
                if site.plan.map is not None:
                    site.plan.map.occupied()
            except ValueError as failure:
                raise BadRecording(f"{self.path}: its {SITE_JSON} is not what it ought to be: {failure}") from failure
            return site
        data = self.attachments.get(WORKSPACE_XML)
        if data is None:
            raise BadRecording(f"{self.path}: it lacks the workspace file")
        # The distances are not checked again: the mission may have had other ones.
        return parse_workspace(data, f"{self.path}: {WORKSPACE_XML}", phi_safer_m=-1.0, spacing_m=0.0)

    def content(self, every_ticks: int = 1) -> Content:
        """Return all events, and the series of every `every_ticks`-th tick.

        Raises:
            BadRecording: see `messages`.
        """
        content = Content.of(self.about)
        for tick in self.ticks():
            content.add(tick, every_ticks)
        return content

    def tracks(self) -> RunTracks:
        """Return the tracks from which a picture of the run is drawn."""
        content = self.content(_DRAWN_TICKS)
        switches = [
            SwitchRecord(
                each.time_s, each.robot_id, None if each.before == AC else each.before,
                None if each.after == AC else each.after, each.module, each.cause, each.joined,
            )
            for each in content.switches
        ]  # fmt: skip
        violations = tuple(
            Violation(each.rule, each.robots, each.start_s, None if each.end_s is UNSET else each.end_s)
            for each in content.violations
        )
        inset_m = self.safer_inset_m
        return RunTracks(self.workspace(), content.drivers, content.series, switches, inset_m, violations)

    @property
    def safer_inset_m(self) -> float | None:
        """How far inside the fence phi_safer of the geofence module begins; None without that module."""
        fence = (module for robot in self.about.robots for module in robot.modules if module.name == "geofence")
        return next((module.edge_margin for module in fence), None)

    def _prove(self) -> Proof | None:
        try:
            return prove(self.path)
        except OSError as failure:
            raise self._unreadable(failure) from failure

    def _unreadable(self, failure: OSError) -> BadRecording:
        other = meant(self.path) if isinstance(failure, FileNotFoundError) else ""
        return BadRecording(f"'{self.path}' cannot be read: {failure.strerror or failure}{other}")

    def _open(self) -> BinaryIO:
        return opened(self.path)

    def _messages(self) -> Iterator[tuple[int, RobotTick | Event | RecordedWay]]:
        """Yield every message of SOTER's own, and the ways of ACs, which are recorded as messages for viewers."""
        names: dict[int, str] = {}
        robots: dict[int, int] = {}
        kinds: dict[int, msgspec.json.Decoder[Any]] = {}
        ticks, ways = msgspec.json.Decoder(RobotTick), msgspec.json.Decoder(foxglove.PosesInFrame)
        way_topics = {foxglove.WAY_TOPIC.format(robot_id=each.robot_id): each.robot_id for each in self.about.robots}
        for record in self._records():
            if isinstance(record, Message):
                decoder = kinds.get(record.channel_id)
                if decoder is not None:
                    yield record.publish_time, self._decode(decoder, record)
                elif record.channel_id in robots:
                    way: foxglove.PosesInFrame = self._decode(ways, record)
                    places = [(pose.position.x, pose.position.y) for pose in way.poses]
                    yield record.publish_time, RecordedWay(record.log_time / 1e9, robots[record.channel_id], places)
            elif isinstance(record, Schema):
                names[record.id] = record.name
            elif isinstance(record, Channel):
                name = names.get(record.schema_id, "")
                known = ticks if name == _TICK else _EVENTS.get(name)
                if known is not None:
                    kinds[record.id] = known
                elif record.topic in way_topics:
                    robots[record.id] = way_topics[record.topic]

    def _records(self, *, head_only: bool = False) -> Iterator[Any]:
        """Yield the records of the file as far as they go; with `head_only` up to the first chunk."""
        try:
            with self._open() as stream:
                reader = StreamReader(
                    stream, validate_crcs=not head_only, record_size_limit=MAX_RECORD_BYTES, emit_chunks=True
                )
                unpacker = Unpacker()
                for record in self._checked(reader, stream):
                    if not isinstance(record, Chunk):
                        yield record
                    elif head_only:
                        return
                    else:
                        yield from self._unpacked(unpacker, record, stream)
        except OSError as failure:
            raise self._unreadable(failure) from failure

    def _unpacked(self, unpacker: Unpacker, chunk: Chunk, stream: BinaryIO) -> Iterator[Any]:
        try:
            yield from unpacker.records(chunk, stream.tell())
        except _DAMAGE as failure:
            raise BadRecording(f"{self.path}: a part of it is damaged: {_why(failure)}") from failure

    def _checked(self, reader: StreamReader, stream: BinaryIO) -> Iterator[Any]:
        records = iter(reader.records)
        begun = False
        attached_bytes = 0
        while True:
            try:
                record = next(records)
            except StopIteration:
                self._truncated = False
                return
            except EndOfFile:
                self._truncated = True
                return
            except CRCValidationError as failure:
                raise BadRecording(f"{self.path}: a part of it is damaged: {failure}") from failure
            except _DAMAGE as failure:
                if begun and isinstance(failure, struct.error) and not stream.read(1):
                    # The file was cut off within the mark at its end, which the reader takes for damage.
                    self._truncated = True
                    return
                raise BadRecording(
                    f"{self.path}: it is no MCAP file, or a damaged one: {_why(failure)}; expected is a recording, as "
                    "`soter run --record FILE.mcap` makes one"
                ) from failure
            begun = True
            if isinstance(record, Header) and record.profile != PROFILE:
                raise BadRecording(f"{self.path}: SOTER did not record it; its profile is '{record.profile}'")
            if isinstance(record, Attachment):
                attached_bytes += len(record.data)
                if attached_bytes > MAX_ATTACHED_BYTES:
                    raise BadRecording(f"{self.path}: its attachments take more than {MAX_ATTACHED_BYTES} bytes")
                self.attachments[record.name] = record.data
            yield record

    def _decode(self, decoder: msgspec.json.Decoder[Any], record: Message) -> Any:
        try:
            return decoder.decode(record.data)
        except (ValueError, RecursionError) as failure:
            raise BadRecording(
                f"{self.path}: a message at {record.log_time / 1e9:.3f} s is not what it ought to be: {failure}"
            ) from failure

    def _decoded(self, data: bytes, kind: type[M] | Any, name: str) -> Any:
        try:
            return msgspec.json.decode(data, type=kind)
        except (ValueError, RecursionError) as failure:
            raise BadRecording(f"{self.path}: its {name} is not what it ought to be: {failure}") from failure


def _why(failure: BaseException) -> str:
    return str(failure) or type(failure).__name__
