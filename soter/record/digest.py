"""Proof that a recording is what was written: a digest over every byte of it, and on request a signature.

The last record of a recording's data holds a SHA-256 over the whole file, in which that record's own digest and
signature read as zeros. So no bit can change unnoticed, the index behind it included. The signature is one of that
hash; the digest is one of the hash and the signature. That there is to be a digest stands in the head of the file.
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
"""What the head of a recording names as its writer, if it is to have a digest."""

RECORD: Final = "soter.digest"
_DIGEST: Final = "sha256"
_SIGNATURE: Final = "signature"
_KEY: Final = "signed by"
_KEYS: Final = (_KEY, _SIGNATURE, _DIGEST)

MAGIC: Final = b"\x89MCAP0\r\n"
"""What every MCAP file begins and ends with."""

DIGEST_DIGITS: Final = 64
SIGNATURE_DIGITS: Final = 128

_HEAD: Final = struct.Struct("<BQ")
_BLOCK_BYTES: Final = 1 << 20
_MOST_BYTES: Final = 1 << 28
_LENGTH: Final = struct.Struct("<I")

Sign = Callable[[bytes], bytes]


class DigestState(Enum):
    """What a recording's digest says of it."""

    WHOLE = "whole"
    CHANGED = "changed"
    CUT_OFF = "cut off"
    NONE = "none"


class Proof(NamedTuple):
    """What was found out about a recording.

    Attributes:
        state: in a word.
        why: what was found, for messages.
        key: the public key of who has signed it, as hexadecimal digits; empty for nobody.
        signed: what the signature is of.
        signature: it; empty for none.
    """

    state: DigestState
    why: str
    key: str = ""
    signed: bytes = b""
    signature: bytes = b""


class Sealed:
    """A stream that hashes what is written to it, and at the end puts the digest where it belongs."""

    def __init__(self, stream: IO[bytes], sign: Sign | None = None, key: bytes = b"") -> None:
        self._stream: Final = stream
        self._sign: Final = sign
        self._key: Final = key
        self._hash: Final = hashlib.sha256()
        self._held: bytearray | None = None
        self._size = 0

    def write(self, data: bytes) -> int:
        """Write; while the end is held, only into memory."""
        self._size += len(data)
        if self._held is None:
            self._hash.update(data)
            self._stream.write(data)
        else:
            self._held += data
        return len(data)

    def tell(self) -> int:
        """Return how much was written."""
        return self._size

    def flush(self) -> None:
        """Hand everything but a held end to the system."""
        self._stream.flush()

    def hold(self) -> dict[str, str]:
        """Hold what follows, and return the record that is to follow first, by its keys."""
        self._held = bytearray()
        signature = "0" * SIGNATURE_DIGITS if self._sign else ""
        return {_KEY: self._key.hex(), _SIGNATURE: signature, _DIGEST: "0" * DIGEST_DIGITS}

    def finish(self) -> None:
        """Write the end, with digest and signature in it."""
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
    """Open a recording, which is not a pipe: it is read more than once, and opening one might wait for ever.

    Raises:
        OSError: it cannot be.
    """
    if path.is_fifo():
        raise OSError(errno.ESPIPE, "it is a pipe, allowed: a file")
    return path.open("rb")


def prove(path: Path) -> Proof:
    """Read a recording and say whether it is what was written.

    Raises:
        OSError: it cannot be read.
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
    """Judge a file whose records do not come to their end: one that was closed has its mark there."""
    if _ends(stream, size):
        return Proof(DigestState.CHANGED, "its records do not fit together")
    return Proof(DigestState.CUT_OFF, "it was cut off, and so has no digest")


def _ends(stream: BinaryIO, size: int) -> bool:
    stream.seek(max(0, size - len(MAGIC)))
    return size >= 2 * len(MAGIC) and stream.read(len(MAGIC)) == MAGIC


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, int, int, bytes | None]]:
    """Yield every record: opcode, where it begins, its length, and what is in it if that matters.

    The last one has None where the file ends before it does.
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
    """Hash so many bytes of a file; all that there are for -1."""
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
    """Yield the values of a digest's record, each with where it begins.

    Raises:
        ValueError: its keys are others.
        struct.error: it ends too early.
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
    """Return a text after its length, and where it ends."""
    begin = at + _LENGTH.size
    end = begin + _LENGTH.unpack_from(content, at)[0]
    return content[begin:end], end
