"""Unpacks the chunks of a recording within limits: files are untrusted, and state their unpacked sizes themselves."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from typing import Final
from zlib import crc32

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError

MAX_CHUNK_BYTES: Final = 1 << 26
"""Most that a chunk may unpack to; SOTER's writer closes its chunks at a megabyte."""

MAX_RATIO: Final = 100
"""Most that all chunks together may unpack to, as a multiple of the bytes read, beyond the first `MAX_CHUNK_BYTES`.
Runs are packed to about a tenth."""


class Unpacker:
    """Unpacks the chunks of one file."""

    def __init__(self) -> None:
        self._unpacked_bytes = 0

    def records(self, chunk: Chunk, read_bytes: int) -> Iterator[Schema | Channel | Message]:
        """Yield the records of a chunk.

        Args:
            chunk: the packed chunk.
            read_bytes: how much of the file was read up to the chunk's end.

        Raises:
            ValueError: it is damaged, or unpacks to too much; mcap and zstandard raise other exceptions as well.
        """
        data = self._unpacked(chunk, read_bytes)
        if chunk.uncompressed_crc != 0 and (found := crc32(data)) != chunk.uncompressed_crc:
            raise CRCValidationError(chunk.uncompressed_crc, found, chunk)
        stream = ReadDataStream(BytesIO(data))
        while stream.count < len(data):
            opcode, length = stream.read1(), stream.read8()
            if length > len(data) - stream.count:
                raise ValueError(f"a record of {length} bytes in what is left of a chunk, {len(data) - stream.count}")
            end = stream.count + length
            if opcode == Opcode.MESSAGE:
                yield Message.read(stream, length)
            elif opcode == Opcode.CHANNEL:
                yield Channel.read(stream)
            elif opcode == Opcode.SCHEMA:
                yield Schema.read(stream)
            else:
                stream.read(length)
            if stream.count != end:
                raise ValueError(f"a record of a chunk has {length} bytes, and is not as long as it says")

    def _unpacked(self, chunk: Chunk, read_bytes: int) -> bytes:
        size = chunk.uncompressed_size
        self._unpacked_bytes += size
        most = min(MAX_CHUNK_BYTES, MAX_CHUNK_BYTES + MAX_RATIO * read_bytes - self._unpacked_bytes + size)
        if size > most:
            raise ValueError(f"a chunk unpacks to {size} bytes, allowed here: at most {most}")
        if chunk.compression == "":
            data = chunk.data
        elif chunk.compression == "zstd":
            # Read up to the checked size, and not to the one that the packed data state.
            with zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES).stream_reader(chunk.data) as reader:
                data = reader.read(size + 1)
        else:
            raise ValueError(f"a chunk is packed by '{chunk.compression[:20]}', known is zstd")
        if len(data) != size:
            raise ValueError(f"a chunk does not unpack to {size} bytes, as it says")
        return data
