"""Reads a recording while it is being written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import BufferedReader, FileIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.records import Channel, Message, Schema

from soter.record.reader import Recording


class RawMessage(NamedTuple):
    """A message as it stands in a file: JSON, with the JSON schema that defines it, at a fleet time."""

    topic: str
    schema: str
    definition: bytes
    data: bytes
    time_ns: int


class GrowingRecording(Recording):
    """A recording that somebody is writing. Reading waits for what is not there yet.

    Whoever writes it never waits for a reader, and does not know of any.

    Args:
        path: the file.
        ended: returns whether nothing more will be written.
        wait: called whenever there is nothing to read for now; returns after a while.

    Raises:
        BadRecording: it is none, or writing ended before anything was said.
    """

    def __init__(self, path: Path, ended: Callable[[], bool], wait: Callable[[], None]) -> None:
        self._ended: Final = ended
        self._wait: Final = wait
        super().__init__(path)

    @property
    def truncated(self) -> bool:
        """Whether the file was not closed; False until it has been read to where it ends."""
        return bool(self._truncated)

    def raw(self) -> Iterator[RawMessage]:
        """Yield every message, those for the eye too.

        Raises:
            BadRecording: something in it is damaged.
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
        """Prove nothing: the digest comes last."""

    def _open(self) -> BinaryIO:
        return _Waiting(self.path, self._ended, self._wait)


class _Waiting(BufferedReader):
    """A file that ends where nothing more will be written to it."""

    def __init__(self, path: Path, ended: Callable[[], bool], wait: Callable[[], None]) -> None:
        super().__init__(FileIO(path))
        self._ended: Final = ended
        self._wait: Final = wait

    def read(self, size: int | None = -1, /) -> bytes:
        wanted = -1 if size is None else size
        data = super().read(wanted)
        while 0 <= len(data) < wanted:
            # Asked before looking again: what is written between the two is not missed.
            ended = self._ended()
            more = super().read(wanted - len(data))
            if not more and ended:
                break
            if not more:
                self._wait()
            data += more
        return data
