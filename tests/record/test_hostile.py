"""Files that are no recordings, or damaged, or made to do harm: refused with a sentence, at a bounded cost."""

from __future__ import annotations

import os
import struct
import tracemalloc
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer

from soter.cli.app import main
from soter.errors import ConfigError
from soter.record import reader
from soter.record.reader import BadRecording, Recording
from soter.record.summary import summarise
from soter.record.unpack import MAX_CHUNK_BYTES
from soter.replay.replay import replay
from soter.report.page.extract import extract
from tests.record.helpers import recorded, rewrite


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of a run."""
    path = tmp_path_factory.mktemp("recordings") / "good.mcap"
    recorded(path, duration_s=1.0)
    return path


def use(path: Path) -> None:
    """Read all that commands read."""
    recording = Recording(path)
    summarise(recording, recording.content())
    extract(recording)
    recording.tracks()
    replay(recording)


def changed(good: Path, target: Path, old: bytes, new: bytes, *, topic: str = "", file: str = "") -> Path:
    """A copy in which something reads otherwise: in the messages of a topic, or in an attachment."""
    found: list[bool] = []

    def change(name: str, data: bytes) -> bytes:
        if name not in (topic, file):
            return data
        found.append(old in data)
        return data.replace(old, new, 1)

    rewrite(good, target, change, change)
    assert any(found), "there was nothing to change"
    return target


@pytest.mark.parametrize(
    ("old", "new", "place", "complaint"),
    [
        (b'"status": "completed"', b'"status": 7', "result.json", "its result.json is not what it ought to be"),
        (b'"violations": {', b'"violations": [{', "result.json", "its result.json"),
        (b'"geofence": 0', b'"geofence": "none"', "result.json", "its result.json"),
        (b'"min_margin": {', b'"min_margin": {"a": {}, ', "result.json", "its result.json"),
        (b'"robot_id":1', b'"robot_id":' + b"9" * 400, "about.json", "its about.json"),
        (b'"seed":1', b'"seed":' + b"9" * 5000, "about.json", "its about.json"),
        (b'"v_max_m_s":0.', b'"v_max_m_s":-0.', "about.json", "it cannot be replayed"),
        (b'"brake_m_s2":1.0', b'"brake_m_s2":0.0', "about.json", "it cannot be replayed"),
        (b'"phi_safer":0.85', b'"phi_safer":' + b"9" * 400, "about.json", r"rta\.battery\.phi_safer"),
        (b'"workspace":"', b'"workspace":"\\u0000', "about.json", r"workspace: it has the character U\+0000"),
        (b'"seed":1', b'"seed":' + b"[" * 100_000, "about.json", "its about.json"),
        (b'"surveillance"', b'"\xff\xfe"', "about.json", "its about.json"),
        (b"<dimension", b"<\xff", "workspace.xml", "workspace.xml"),
        (b'"x_m":', b'"y_m":', "/targets", "a target that begins at .* has no place"),
        (b'"target_id":', b'"target_id":1e300,"x":', "/targets", "is not what it ought to be"),
        (b'"controller":"SC"', b'"controller":"me"', "/robots/1/tick", "it cannot be replayed"),
        (b'"margin":', b'"margin_is":"much","m":', "/robots/1/tick", "is not what it ought to be"),
        (b'"name":"geofence"', b'"name":"fence"', "/robots/1/tick", "has not the modules of its robot"),
        (b'"tick":', b'"tick":1' + b"0" * 400 + b',"t":', "/robots/1/tick", "is not what it ought to be"),
        (b'"x_m":', b'"x_m":1' + b"0" * 400 + b',"t":', "/robots/1/tick", "is not what it ought to be"),
    ],
)
def test_what_is_not_what_it_ought_to_be_is_named(
    good: Path, tmp_path: Path, old: bytes, new: bytes, place: str, complaint: str
) -> None:
    where = {"topic": place} if place.startswith("/") else {"file": place}
    with pytest.raises(ConfigError, match=complaint):
        use(changed(good, tmp_path / "bad.mcap", old, new, **where))


# --- chunks --------------------------------------------------------------------------------------------------


def with_chunk(good: Path, target: Path, chunk: Chunk) -> Path:
    """A recording whose head is good, and whose first chunk is this one."""
    data = good.read_bytes()
    builder = RecordBuilder()
    chunk.write(builder)
    at = 8
    while data[at] != Opcode.CHUNK:
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    target.write_bytes(data[:at] + builder.end())  # type: ignore[no-untyped-call]
    return target


def chunk(data: bytes, size: int | None = None, compression: str = "zstd") -> Chunk:
    packed = zstandard.compress(data) if compression == "zstd" else data
    return Chunk(compression, packed, 0, 0, 0, len(data) if size is None else size)


BOMB = bytes(4 * MAX_CHUNK_BYTES)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: chunk(BOMB), "unpacks to 268435456 bytes, allowed here: at most 67108864"),
        (lambda: chunk(BOMB, 1000), "does not unpack to 1000 bytes"),
        (lambda: chunk(BOMB, 2**63), "unpacks to 9223372036854775808 bytes"),
        (lambda: chunk(b"abc", 4), "does not unpack to 4 bytes"),
        (lambda: chunk(b"abc", compression="lz4"), "packed by 'lz4', known is zstd"),
        (lambda: chunk(b"abc", compression="x" * 1000), "packed by 'xxxx"),
        (lambda: chunk(struct.pack("<BQ", Opcode.MESSAGE, 2**63)), "in what is left of a chunk"),
        (lambda: chunk(struct.pack("<BQ", Opcode.MESSAGE, 3) + b"abc"), "a part of it is damaged"),
        (lambda: chunk(struct.pack("<BQHI", Opcode.SCHEMA, 6, 1, 2**32 - 1)), "a part of it is damaged"),
        (lambda: chunk(struct.pack("<BQHI", Opcode.SCHEMA, 8, 1, 2) + b"\xff\xff"), "a part of it is damaged"),
    ],
)
def test_a_chunk_unpacks_within_limits(good: Path, tmp_path: Path, make: Callable[[], Chunk], complaint: str) -> None:
    path = with_chunk(good, tmp_path / "bad.mcap", make())
    tracemalloc.start()
    try:
        with pytest.raises(BadRecording, match=complaint):
            use(path)
        assert tracemalloc.get_traced_memory()[1] < 3 * MAX_CHUNK_BYTES
    finally:
        tracemalloc.stop()


def test_many_chunks_unpack_within_limits_too(good: Path, tmp_path: Path) -> None:
    path = with_chunk(
        good,
        tmp_path / "bad.mcap",
        chunk(struct.pack("<BQ", 0x7F, MAX_CHUNK_BYTES // 2) + BOMB[: MAX_CHUNK_BYTES // 2]),
    )
    data = path.read_bytes()
    at = 8
    while data[at] != Opcode.CHUNK:
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    path.write_bytes(data + 9 * data[at:])
    with pytest.raises(BadRecording, match="allowed here: at most"):
        use(path)


@pytest.mark.parametrize("length", [0, 1, 7, 8, 9, 40, 1000])
def test_any_beginning_of_a_file_is_read_or_refused(good: Path, tmp_path: Path, length: int) -> None:
    path = tmp_path / "bad.mcap"
    path.write_bytes(good.read_bytes()[:length])
    with pytest.raises(BadRecording):
        use(path)


def test_a_pipe_is_refused_whoever_is_at_its_other_end(tmp_path: Path) -> None:
    pipe = tmp_path / "run.mcap"
    os.mkfifo(pipe)
    with pytest.raises(BadRecording, match="it is a pipe"):
        use(pipe)
    with pytest.raises(ConfigError, match="cannot be recorded to: No such device"):
        recorded(pipe, duration_s=1.0)


def test_attachments_have_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "MAX_ATTACHED_BYTES", 4000)
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.NONE)
    writer.start(profile="soter")
    for name in range(5):
        writer.add_attachment(0, 0, str(name), "text/plain", bytes(1000))
    path = tmp_path / "bad.mcap"
    path.write_bytes(out.getvalue())
    with pytest.raises(BadRecording, match="its attachments take more than 4000 bytes"):
        Recording(path)


@pytest.mark.parametrize("command", [("info",), ("replay",), ("report", "-o", "page.html")])
def test_a_command_refuses_it_with_one_sentence(
    command: tuple[str, ...],
    good: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = changed(good, tmp_path / "bad.mcap", b'"geofence": 0', b'"geofence": "none"', file="result.json")
    if command[0] == "replay":
        path = with_chunk(good, path, chunk(BOMB))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["soter", command[0], str(path), *command[1:]])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1
