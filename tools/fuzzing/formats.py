"""What is read: for each format good inputs, how they are spoilt, and everything that reads them."""

from __future__ import annotations

import random
import struct
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from mcap.records import Attachment, Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.pymavlink_link import PymavlinkLink
from soter.adapters.mavlink.transport import Address
from soter.adapters.mavlink.vehicle import Vehicle
from soter.adapters.zenoh.messages import KINDS, Foreign, decode, encode
from soter.clock import VehicleClock
from soter.config import load_mission, parse_mission
from soter.distribution.channel import ChannelFrame, Ended, VisitMessage, decode_frame
from soter.distribution.status import Echo, RobotStatus, Status, decode_status
from soter.errors import ConfigError, Garbage, IllFormedModule
from soter.geometry.workspace_xml import parse_workspace
from soter.isolation.messages import Ask, FailedForGood, Moved, Started, TargetGiven, Turn, decode_up
from soter.isolation.messages import encode as encode_message
from soter.onboard.command import Command, GoalMessage, Report
from soter.onboard.wire import AC, SC, GateReport, Order
from soter.record.reader import Recording
from soter.record.summary import summarise
from soter.replay.replay import replay
from soter.report.page.extract import extract
from soter.runner import run_mission
from soter.sdk import RobotState, Waypoint
from soter.sdk.values import Link
from soter_sim.mavlink.channel import Channel as SimChannel
from tools.fuzzing import worlds
from tools.fuzzing.mutate import spoil, spoil_word

ROOT: Final = Path(__file__).resolve().parents[2]
MISSION: Final = ROOT / "examples" / "surveillance.toml"
_MAVLINK_2: Final = 0xFD
_HERE: Final = ("127.0.0.1", 1)


@dataclass(frozen=True)
class Format:
    """One kind of input.

    Attributes:
        seeds: good ones.
        read: everything that reads one; returns where it was refused as it should be.
        spoil: makes a bad one of a good one, or leaves it good.
    """

    seeds: tuple[bytes, ...]
    read: Callable[[bytes], None]
    spoil: Callable[[bytes, Sequence[bytes], random.Random], bytes] = spoil

    def spoilt(self, seed: int) -> bytes:
        """Return an input, the same for the same number."""
        draw = random.Random(seed)
        return self.spoil(draw.choice(self.seeds), self.seeds, draw)


def make(name: str) -> Format:
    """Return a format by its name, one of `NAMES`."""
    return _MAKERS[name]()


# --- messages ------------------------------------------------------------------------------------------------


def _refused(read: Callable[[Any], object], data: Any, *refusals: type[Exception]) -> None:
    try:
        read(data)
    except refusals:
        return


def _order() -> Format:
    said = (Order("ab12", 7, AC, 1012.5), Order("ab12", 8, SC, None), GateReport("ab12", 7, AC, True))

    def read(data: bytes) -> None:
        for given in (data, data.decode(errors="replace")):
            _refused(Order.decode, given, ValueError)
            _refused(GateReport.decode, given, ValueError)

    return Format(tuple(each.encode().encode() for each in said), read)


def _command() -> Format:
    goal = GoalMessage(3, AC, 1.0, 2.0, 0.0, 0.5, None)
    report = Report(1, "c1", 12.5, 1.0, 2.0, 0.5, 0.1, 0.0, 0.0, 0.9, GateReport("ab12", 7, AC, True), 3)
    said = (Command("ab12", 7, AC, "c1", 12.5, goal), Command("ab12", 8, SC, "", None, None), report)

    def read(data: bytes) -> None:
        _refused(Command.decode, data, ValueError)
        _refused(Report.decode, data, ValueError)

    return Format(tuple(each.encode() for each in said), read)


def _messagepack() -> Format:
    state = RobotState(1, 1.0, 2.0, 0.5, 0.5, 0.0, 0.1, 0.2, 0.0, 0.0, 0.9, None, 3, Link.UP)
    turn = Turn(
        3, (Ask(1, 1, 2, Waypoint(1.0, 2.0), (Waypoint(2.0, 2.0),)),), (TargetGiven(1, 1, 1.0, 1.0),),
        (FailedForGood(1, "it fell"),), ("it rained",), 0, (Moved(1.0, "m", 1, "n", "a", "b", "e", "d"),),
    )  # fmt: skip
    status = Status("alpha", 7, "m", 1, 2.0, (RobotStatus(state, True, "", False),), (Echo("beta", 8, 1.0, 0.1),))
    frame = ChannelFrame(7, 8, "m", 1, 2, 3, 4, (VisitMessage(1, 2, 1.0, 1.0, 60.0, 3), Ended(1, 2, "reached")))

    def read(data: bytes) -> None:
        for each in (decode_up, decode_frame, decode_status):
            _refused(each, data, Garbage)

    return Format(
        (encode_message(turn), encode_message(Started()), encode_message(status), encode_message(frame)), read
    )


def _cdr() -> Format:
    def read(data: bytes) -> None:
        made: Any
        for made in KINDS:
            _refused(partial(decode, made), data, Foreign)

    empty: list[Any] = [kind() for kind in KINDS]
    return Format(tuple(encode(each) for each in empty), read)


def _mavlink() -> Format:
    sender = mav.MAVLink(None, 1, 1)
    said = (
        mav.MAVLink_heartbeat_message(10, 3, 0, 15, 4, 3), mav.MAVLink_timesync_message(5, 6),
        mav.MAVLink_local_position_ned_message(10, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0),
        mav.MAVLink_command_ack_message(400, 0), mav.MAVLink_statustext_message(2, b"PreArm: \xff\x1b[2J"),
        mav.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    )  # fmt: skip
    packets, stream = (
        PymavlinkLink(VehicleClock(), Address("udpin", "127.0.0.1", 1), 255, COMPONENTS) for _ in range(2)
    )
    for link in (packets, stream):
        link.inboxes[1] = Inbox()
        Vehicle(link, 1)
    simulated = SimChannel(lambda _: None, None, datagrams=False)

    def read(data: bytes) -> None:
        packets._take(data, _HERE)
        stream._take(data, None)
        for _ in simulated.parse(data):
            pass
        if len(simulated._parser.buf) + len(stream._parser.buf) > 1 << 17:
            raise AssertionError("a parser keeps what it has read")

    def spoil_frame(data: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
        data = spoil(data, others, draw)
        return _with_checksum(data) if draw.random() < 0.7 else data

    return Format(tuple(bytes(each.pack(sender)) for each in said), read, spoil_frame)


def _with_checksum(frame: bytes) -> bytes:
    """Return a frame with its length and checksum put right, so that what is wrong is what it says."""
    if len(frame) < 12 or frame[0] != _MAVLINK_2:
        return frame
    kind = mav.mavlink_map.get(int.from_bytes(frame[7:10], "little"))
    body = frame[1:1] + bytes([min(len(frame) - 12, 255), 0]) + frame[3 : 10 + min(len(frame) - 12, 255)]
    crc = mav.x25crc(body + bytes([getattr(kind, "crc_extra", 0)])).crc
    return frame[:1] + body + struct.pack("<H", crc)


# --- files ---------------------------------------------------------------------------------------------------


def _examples(suffix: str) -> tuple[bytes, ...]:
    return tuple(
        path.read_bytes() for path in sorted((ROOT / "examples").rglob(f"*{suffix}")) if path.name != "pyproject.toml"
    )


def _toml() -> Format:
    return Format(_examples(".toml"), lambda data: _refused(lambda given: parse_mission(given, "f"), data, ConfigError))


def _xml() -> Format:
    def read(data: bytes) -> None:
        worlds.check(parse_workspace(data, "f"))

    return Format(_examples(".xml"), lambda data: _refused(read, data, ConfigError))


def _world(name: str) -> Format:
    folder = tempfile.TemporaryDirectory(prefix="soter-fuzz-")
    read = worlds.reader(name, Path(folder.name))
    made = Format(worlds.seeds(name), lambda data: _refused(read, data, ConfigError))
    object.__setattr__(made, "_folder", folder)
    return made


def _mcap() -> Format:
    folder = tempfile.TemporaryDirectory(prefix="soter-fuzz-")
    seed, file = Path(folder.name) / "seed.mcap", Path(folder.name) / "file.mcap"
    options = {"backend": "kinematic", "planner": "straight-line", "duration_s": 1.5}
    run_mission(load_mission(MISSION, options), record=seed)
    content = [each for each in StreamReader(BytesIO(seed.read_bytes())).records if isinstance(each, _CONTENT)]

    def read(data: bytes) -> None:
        file.write_bytes(data)
        _refused(_use, file, ConfigError, IllFormedModule)

    def spoil_content(data: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
        return spoil(data, others, draw) if draw.random() < 0.5 else _rewritten(content, draw)

    made = Format((seed.read_bytes(),), read, spoil_content)
    object.__setattr__(made, "_folder", folder)
    return made


_CONTENT: Final = (Schema, Channel, Attachment, Message)


def _rewritten(content: Sequence[Any], draw: random.Random) -> bytes:
    """Return a recording whose checksums are right, and whose messages or files are not."""
    out = BytesIO()
    writer = Writer(out)
    writer.start(profile="soter", library="fuzz")
    said = [at for at, each in enumerate(content) if isinstance(each, Message | Attachment)]
    files = [at for at in said if isinstance(content[at], Attachment)]
    wrong = set(draw.sample(files if draw.random() < 0.4 else said, 1))
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for at, each in enumerate(content):
        data = each.data if isinstance(each, Message | Attachment) else b""
        if at in wrong:
            data = (spoil_word if draw.random() < 0.8 else spoil)(data, [data], draw)
        if isinstance(each, Schema):
            if each.id not in schemas:
                schemas[each.id] = writer.register_schema(each.name, each.encoding, each.data)
        elif isinstance(each, Channel):
            if each.id not in channels:
                channels[each.id] = writer.register_channel(each.topic, each.message_encoding, schemas[each.schema_id])
        elif isinstance(each, Attachment):
            writer.add_attachment(0, 0, each.name, each.media_type, data)
        else:
            writer.add_message(channels[each.channel_id], each.log_time, data, each.publish_time, each.sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _use(file: Path) -> None:
    """Do with a recording what commands do."""
    recording = Recording(file)
    summarise(recording, recording.content())
    extract(recording)
    recording.tracks()
    replay(recording)


_MAKERS: Final[dict[str, Callable[[], Format]]] = {
    "order": _order,
    "command": _command,
    "messagepack": _messagepack,
    "cdr": _cdr,
    "mavlink": _mavlink,
    "xml": _xml,
    "toml": _toml,
    "mcap": _mcap,
    **{name: partial(_world, name) for name in worlds.NAMES},
}
NAMES: Final = tuple(_MAKERS)
