"""Reads a recording while it is being written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import BufferedReader, FileIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.records import Channel, Message, Schema

from soter.record.reader import Recording


class RawMessage(NamedTuple):
    """A message as the file holds it: JSON, with its JSON schema, at a fleet time."""

    topic: str
    schema: str
    definition: bytes
    data: bytes
    time_ns: int


class GrowingRecording(Recording):
    """A recording that is still being written. Reading waits for data that is not there yet.

    The writer never waits for readers, and does not know of them.

    Args:
        path: the file.
        ended: returns whether nothing more will be written.
        wait: called when there is nothing to read at the moment; returns after a while.

    Raises:
        BadRecording: the file is no recording, or writing ended before the run was described.
    """

    def __init__(self, path: Path, ended: Callable[[], bool], wait: Callable[[], None]) -> None:
        self._ended: Final = ended
        self._wait: Final = wait
        super().__init__(path)

    @property
    def truncated(self) -> bool:
        """Whether the file was not closed; False until it has been read to its end."""
        return bool(self._truncated)

    def raw(self) -> Iterator[RawMessage]:
        """Yield every message, including those for viewers.

        Raises:
            BadRecording: a part of the file is damaged.
        """
        schemas: dict[int, Schema] = {}
        channels: dict[int, tuple[str, Schema]] = {}
        for record in self._records():
            if isinstance(record, Message):
                topic, schema = channels[record.channel_id]
                yield RawMessage(topic, schema.name, schema.data, record.data, record.log_time)
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record.topic, schemas[record.schema_id]

    def _prove(self) -> None:
        """Return None: the digest is only written at the end."""

    def _open(self) -> BinaryIO:
        return _Waiting(self.path, self._ended, self._wait)


class _Waiting(BufferedReader):
    """A file whose end is reached only once nothing more will be written to it."""

    def __init__(self, path: Path, ended: Callable[[], bool], wait: Callable[[], None]) -> None:
        super().__init__(FileIO(path))
        self._ended: Final = ended
        self._wait: Final = wait

    def read(self, size: int | None = -1, /) -> bytes:
        wanted = -1 if size is None else size
        data = super().read(wanted)
        while 0 <= len(data) < wanted:
            # Checked before reading again, so that data written in between is not missed.
            ended = self._ended()
            more = super().read(wanted - len(data))
            if not more and ended:
                break
            if not more:
                self._wait()
            data += more
        return data
