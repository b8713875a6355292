"""Proof that a recording is unchanged: a digest over every byte of it, and on request a signature.

The last record of a recording's data holds both. The whole file is hashed with SHA-256, with zeros in place of them;
so no bit can change unnoticed, the index behind that record included. The signature signs that hash;
the digest covers the hash and the signature. The head of the file says that there must be a digest.
"""

from __future__ import annotations

import errno
import hashlib
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import IO, BinaryIO, Final, NamedTuple

from mcap.opcode import Opcode

LIBRARY: Final = "soter, with digest"
"""Name of the writer in the head of a recording that must have a digest."""

RECORD: Final = "soter.digest"
_DIGEST: Final = "sha256"
_SIGNATURE: Final = "signature"
_KEY: Final = "signed by"
_KEYS: Final = (_KEY, _SIGNATURE, _DIGEST)

MAGIC: Final = b"\x89MCAP0\r\n"
"""The bytes that every MCAP file begins and ends with."""

DIGEST_DIGITS: Final = 64
SIGNATURE_DIGITS: Final = 128

_HEAD: Final = struct.Struct("<BQ")
_BLOCK_BYTES: Final = 1 << 20
_MOST_BYTES: Final = 1 << 28
_LENGTH: Final = struct.Struct("<I")

Sign = Callable[[bytes], bytes]


class DigestState(Enum):
    """The result of checking a recording's digest."""

    WHOLE = "whole"
    CHANGED = "changed"
    CUT_OFF = "cut off"
    NONE = "none"


class Proof(NamedTuple):
    """What is proved about a recording.

    Attributes:
        state: the result of checking the digest.
        why: the finding, for messages.
        key: the public key of the signer, as hexadecimal digits; empty if not signed.
        signed: the bytes that the signature signs.
        signature: the signature; empty if not signed.
    """

    state: DigestState
    why: str
    key: str = ""
    signed: bytes = b""
    signature: bytes = b""


class Sealed:
    """A stream that hashes all that is written to it, and at the end puts the digest into its record."""

    def __init__(self, stream: IO[bytes], sign: Sign | None = None, key: bytes = b"") -> None:
        self._stream: Final = stream
        self._sign: Final = sign
        self._key: Final = key
        self._hash: Final = hashlib.sha256()
        self._held: bytearray | None = None
        self._size = 0

    def write(self, data: bytes) -> int:
        """Write data; after `hold`, only into memory."""
        self._size += len(data)
        if self._held is None:
            self._hash.update(data)
            self._stream.write(data)
        else:
            self._held += data
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._size

    def flush(self) -> None:
        """Hand all data to the system but what is held in memory."""
        self._stream.flush()

    def hold(self) -> dict[str, str]:
        """Hold all later data in memory; return the keys and values of the record to write next."""
        self._held = bytearray()
        signature = "0" * SIGNATURE_DIGITS if self._sign else ""
        return {_KEY: self._key.hex(), _SIGNATURE: signature, _DIGEST: "0" * DIGEST_DIGITS}

    def finish(self) -> None:
        """Write the held data, with digest and signature filled in."""
        held = self._held
        assert held is not None
        opcode, length = _HEAD.unpack_from(held)
        assert opcode == Opcode.METADATA
        values = dict(zip(_KEYS, _values(bytes(held[_HEAD.size : _HEAD.size + length])), strict=True))
        self._hash.update(held)
        signed = self._hash.digest()
        signature = b"" if self._sign is None else self._sign(signed)
        for name, digits in ((_SIGNATURE, signature.hex()), (_DIGEST, _digest(signed, signature))):
            at = _HEAD.size + values[name][0]
            held[at : at + len(digits)] = digits.encode()
        self._stream.write(held)


def opened(path: Path) -> BinaryIO:
    """Open a recording. Pipes are refused: a recording is read more than once, and opening a pipe may wait for ever.

    Raises:
        OSError: the file cannot be opened, or is a pipe.
    """
    if path.is_fifo():
        raise OSError(errno.ESPIPE, "it is a pipe, allowed: a file")
    return path.open("rb")


def prove(path: Path) -> Proof:
    """Read a recording, and return whether it is unchanged since it was written.

    Raises:
        OSError: the file cannot be read.
    """
    with opened(path) as stream:
        return _proof(stream, os.fstat(stream.fileno()).st_size)


def _proof(stream: BinaryIO, size: int) -> Proof:
    if stream.read(len(MAGIC)) != MAGIC:
        return Proof(DigestState.CHANGED, "it does not begin as a recording")
    found: tuple[int, bytes] | None = None
    expected = False
    last = 0
    for opcode, at, length, content in _records(stream, size):
        last = opcode
        if content is None:
            return _broken(stream, size)
        if opcode == Opcode.HEADER:
            expected = _library(content) == LIBRARY.encode()
        elif opcode == Opcode.ATTACHMENT and not _attached(content):
            return Proof(DigestState.CHANGED, f"an attachment at byte {at} does not fit its checksum")
        elif opcode == Opcode.METADATA and content.startswith(_LENGTH.pack(len(RECORD)) + RECORD.encode()):
            found = at + _HEAD.size, content
        if opcode == Opcode.FOOTER:
            rest = size - at - _HEAD.size - length
            if rest < len(MAGIC):
                return _broken(stream, size)
            if rest > len(MAGIC) or not _ends(stream, size):
                return Proof(DigestState.CHANGED, "the mark is not at its end")
            break
    if last != Opcode.FOOTER:
        return _broken(stream, size)
    if found is None:
        if expected:
            return Proof(DigestState.CHANGED, "its digest is not there")
        return Proof(DigestState.NONE, "it has no digest: an older version of SOTER, or something else, wrote it")
    return _compared(stream, *found)


def _compared(stream: BinaryIO, at: int, content: bytes) -> Proof:
    try:
        values = dict(zip(_KEYS, _values(content), strict=True))
        key, digest = (values[name][1].decode() for name in (_KEY, _DIGEST))
        digits = values[_SIGNATURE][1].decode()
        signature = bytes.fromhex(digits)
        if signature.hex() != digits:
            raise ValueError(digits)
    except (ValueError, struct.error):
        return Proof(DigestState.CHANGED, "its digest is not what it ought to be")
    zeros = [(at + values[name][0], len(values[name][1])) for name in (_SIGNATURE, _DIGEST)]
    hashed = hashlib.sha256()
    stream.seek(0)
    for start, length in zeros:
        _feed(hashed, stream, start - stream.tell())
        hashed.update(b"0" * length)
        stream.seek(length, os.SEEK_CUR)
    _feed(hashed, stream, -1)
    signed = hashed.digest()
    if _digest(signed, signature) != digest:
        return Proof(DigestState.CHANGED, "it does not fit its digest")
    return Proof(DigestState.WHOLE, "it fits its digest", key, signed, signature)


def _broken(stream: BinaryIO, size: int) -> Proof:
    """Judge a file with an incomplete record: changed if it ends with MCAP's mark, as closed files do, else cut off."""
    if _ends(stream, size):
        return Proof(DigestState.CHANGED, "its records do not fit together")
    return Proof(DigestState.CUT_OFF, "it was cut off, and so has no digest")


def _ends(stream: BinaryIO, size: int) -> bool:
    stream.seek(max(0, size - len(MAGIC)))
    return size >= 2 * len(MAGIC) and stream.read(len(MAGIC)) == MAGIC


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, int, int, bytes | None]]:
    """Yield every record: opcode, position, length, and the content if it matters.

    The content of the last record is None if the file ends within it.
    """
    at = len(MAGIC)
    while at < size:
        stream.seek(at)
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            yield 0, at, 0, None
            return
        opcode, length = _HEAD.unpack(head)
        if at + _HEAD.size + length > size:
            yield opcode, at, length, None
            return
        wanted = opcode in {Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA} and length <= _MOST_BYTES
        yield opcode, at, length, stream.read(length) if wanted else b""
        at += _HEAD.size + length


def _feed(hashed: hashlib._Hash, stream: BinaryIO, length: int) -> None:
    """Hash `length` bytes of a file; the rest of it for -1."""
    while length:
        data = stream.read(_BLOCK_BYTES if length < 0 else min(length, _BLOCK_BYTES))
        if not data:
            return
        hashed.update(data)
        length -= len(data) if length > 0 else 0


def _digest(signed: bytes, signature: bytes) -> str:
    return hashlib.sha256(signed + signature).hexdigest()


def _library(content: bytes) -> bytes:
    try:
        _, at = _text(content, 0)
        return _text(content, at)[0]
    except struct.error:
        return b""


def _attached(content: bytes) -> bool:
    (crc,) = _LENGTH.unpack(content[-_LENGTH.size :]) if len(content) >= _LENGTH.size else (1,)
    return crc in {0, zlib.crc32(content[: -_LENGTH.size])}


def _values(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the values of a digest's record, each with its position.

    Raises:
        ValueError: the record has other keys.
        struct.error: the record ends too early.
    """
    at = _text(content, 0)[1] + _LENGTH.size
    for name in _KEYS:
        key, at = _text(content, at)
        if key != name.encode():
            raise ValueError(key)
        value, end = _text(content, at)
        yield at + _LENGTH.size, value
        at = end


def _text(content: bytes, at: int) -> tuple[bytes, int]:
    """Return a text with a length prefix, and the position of its end."""
    begin = at + _LENGTH.size
    end = begin + _LENGTH.unpack_from(content, at)[0]
    return content[begin:end], end
