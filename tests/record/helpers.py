"""Recordings to look at: made by real runs, and changed afterwards."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from soter.config import MissionFile, load_mission
from soter.record.digest import RECORD
from soter.runner import Run, metrics, run_mission
from tests.project.source import ROOT
from tests.waiting import wait_until

SURVEILLANCE = ROOT / "examples" / "surveillance.toml"
ZONE = ROOT / "examples" / "modules" / "zone.toml"
QUICK: dict[str, object] = {"backend": "kinematic", "planner": "straight-line"}


def mission(**overrides: object) -> MissionFile:
    """A mission on the kinematic engine; double underscores in names stand for dots."""
    given = {name.replace("__", "."): value for name, value in overrides.items()}
    return load_mission(SURVEILLANCE, {**QUICK, **given})


def recorded(path: Path, **overrides: object) -> Run:
    """Run a mission and record it."""
    return run_mission(mission(**overrides), record=path)


def zone_broken(path: Path) -> Run:
    """Record a run in which both robots break a rule of a user's own, whose module is switched off, and no other."""
    settings = {**QUICK, "duration_s": 120.0, "rta.module.zone-speed.enabled": False}
    return run_mission(load_mission(ZONE, settings), record=path)


STANDING_S = 70.0


def standing(path: Path) -> Run:
    """Record a run in which nobody hears of robot 1: no robot gets its AC, and none moves, from the start to the end.

    For being without its AC 20 s count as a stall, in place of 300 s: so the run is short.
    """
    silent = {"kind": "kill", "robot": 1, "start_s": 0.05, "declared": False}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(metrics, "STALL_S", 20.0)
        return recorded(path, duration_s=STANDING_S, fault=[silent])


def rewrite(
    source: Path,
    target: Path,
    change: Callable[[str, bytes], bytes | None],
    change_file: Callable[[str, bytes], bytes] = lambda name, data: data,
) -> None:
    """Copy a recording message by message; what `change(topic, data)` returns takes a message's place, None removes it.

    What `change_file(name, data)` returns takes an attachment's. The checksums of the copy are right: this is what a
    faulty tool does, not a faulty disk; nor does it know of digests.
    """
    with source.open("rb") as stream, target.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="soter", library="test")
        schemas: dict[int, int] = {}
        channels: dict[int, tuple[int, str]] = {}
        for record in StreamReader(stream).records:
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels:
                number = writer.register_channel(record.topic, record.message_encoding, schemas[record.schema_id])
                channels[record.id] = (number, record.topic)
            elif isinstance(record, Attachment):
                writer.add_attachment(0, 0, record.name, record.media_type, change_file(record.name, record.data))
            elif isinstance(record, Metadata) and record.name != RECORD:
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Message):
                number, topic = channels[record.channel_id]
                data = change(topic, record.data)
                if data is not None:
                    writer.add_message(number, record.log_time, data, record.publish_time, record.sequence)
        writer.finish()  # type: ignore[no-untyped-call]


def every_message(path: Path) -> Iterator[tuple[str, str, bytes, bytes]]:
    """Topic, schema's name, schema and data of every message of a file."""
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    with path.open("rb") as stream:
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                schema = schemas[channel.schema_id]
                yield channel.topic, schema.name, schema.data, record.data


# --- a run as a process --------------------------------------------------------------------------------------


@contextmanager
def running(mission: Path, *arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """`soter run` as a process, in a session of its own; it is killed at the end."""
    with subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", str(mission), *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Who runs tests in the background may have it ignored, and that would be left to the run.
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    ) as process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def started(path: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """`soter run` as a process that records to a file, from the moment on in which something stands there."""
    with running(SURVEILLANCE, "--record", path, "--quiet", *arguments) as process:
        wait_until(lambda: path.exists() and path.stat().st_size > 0)
        yield process


def writer_of(pid: int) -> int:
    """The process that writes a run's recording."""
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        if "soter.record.writer" in Path(f"/proc/{child}/cmdline").read_text():
            return int(child)
    raise AssertionError("it has no writer")


def processor_wait_s(*pids: int) -> float:
    """For how long processes have waited for a processor so far, all together; 0 where the kernel does not say."""
    waited_ns = 0
    for pid in pids:
        with suppress(FileNotFoundError):
            waited_ns += int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])
    return waited_ns / 1e9
