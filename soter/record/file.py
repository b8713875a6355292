"""Writes a recording as an MCAP file: channels and schemas, and chunks that are closed in time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import IO, Any, Final

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from msgspec import Struct

from soter.record import foxglove, messages
from soter.record.digest import LIBRARY, RECORD, Sealed, Sign

PROFILE: Final = "soter"
CHUNK_BYTES: Final = 1 << 20

_encode: Final = msgspec.json.Encoder().encode


def json_schema(message: type[Struct]) -> dict[str, Any]:
    """Return the JSON schema of a message, with an object at its root, as MCAP's readers require."""
    schema = msgspec.json.schema(message)
    definitions = schema.pop("$defs")
    root = definitions.pop(schema.pop("$ref").rpartition("/")[2])
    return {**root, "$defs": definitions} if definitions else root


def channels(robot_ids: Iterable[int]) -> dict[str, type[Struct]]:
    """Return every topic that a recording of some robots may have, with its message."""
    given: list[tuple[str, type[Struct]]] = [(topic, kind) for kind, topic in messages.TOPICS.items()]
    given += [(topic, kind) for kind, topics in foxglove.TOPICS.items() for topic in topics]
    ids = list(robot_ids)
    return {
        topic.format(robot_id=robot_id): kind for topic, kind in given for robot_id in (ids if "{" in topic else [0])
    }


def definition(message: type[Struct]) -> bytes:
    """Return the JSON schema of a message as the bytes that a recording holds."""
    return _encode(json_schema(message))


class RecordingFile:
    """The file of one recording. Times are nanoseconds of fleet time and, for publishing, of the host's day.

    Args:
        stream: the buffered binary file to write to.
        sign: returns a signature of the file's hash; None to leave it unsigned.
        key: the public key that verifies the signature.

    Raises:
        OSError: from every method, if the file cannot be written.
    """

    def __init__(self, stream: IO[bytes], sign: Sign | None = None, key: bytes = b"") -> None:
        self._stream: Final = Sealed(stream, sign, key)
        out: Any = self._stream
        self._writer: Final = Writer(out, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._schemas: Final[dict[type[Struct], int]] = {}
        self._channels: Final[dict[str, int]] = {}
        self._sequences: Final[dict[int, int]] = {}
        self._pending = False
        self._writer.start(profile=PROFILE, library=LIBRARY)

    def attach(self, name: str, data: bytes, media_type: str) -> None:
        """Add a file as an attachment."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def describe(self, name: str, values: Mapping[str, str]) -> None:
        """Add keys and values as metadata, which every MCAP tool shows."""
        self._writer.add_metadata(name, dict(values))

    def write(self, topic: str, message: Struct, time_ns: int, host_ns: int) -> None:
        """Add a message."""
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channel(topic, type(message))
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        self._writer.add_message(channel, time_ns, _encode(message), host_ns, sequence)
        self._pending = True

    def flush(self) -> None:
        """Close the chunk and hand all data to the system, so that it can be read whatever happens later."""
        if self._pending:
            self._pending = False
            self._writer.flush()  # type: ignore[no-untyped-call]
        self._stream.flush()

    def finish(self) -> None:
        """Write the digest, and the index, without which a reader has to go through the whole file."""
        self.flush()
        self._writer.add_metadata(RECORD, self._stream.hold())
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.finish()
        self._stream.flush()

    def _channel(self, topic: str, message: type[Struct]) -> int:
        schema = self._schemas.get(message)
        if schema is None:
            name, data = messages.schema_name(message), definition(message)
            schema = self._writer.register_schema(name, SchemaEncoding.JSONSchema, data)
            self._schemas[message] = schema
        channel = self._writer.register_channel(topic, MessageEncoding.JSON, schema)
        self._channels[topic], self._sequences[channel] = channel, 0
        return channel
