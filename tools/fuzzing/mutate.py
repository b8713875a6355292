"""Good inputs, spoilt: bits, bytes, pieces, numbers and words, the same for the same seed."""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Sequence
from typing import Final

_WORD: Final = re.compile(rb'-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|"[^"\n]*"|\btrue\b|\bfalse\b|\bnull\b')
_WORDS: Final = (
    b"0", b"-1", b"1e-320", b"1e-300", b"1e300", b"-1e308", b"1e400", b"9" * 400, b"NaN", b"nan", b"-inf", b"null",
    b"true", b'""', b'"\x1b[31m"', b'"\\u0000\\u202e"', b'"' + b"x" * 500 + b'"', b"[]", b"{}", b"[[[[[[]]]]]]",
    b"1 2", b"-0.0", b"2147483648", b"18446744073709551616", b'"AC"', b"0.05", b"1", b"64", b"1979-05-27",
)  # fmt: skip
_PIECES: Final = (
    b"\0", b"\xff", b"\x7f\xff\xff\xff", b"\xff" * 8, b"[" * 400, b'{"a":' * 400, b"\xc2\x85", b"\xed\xa0\x80", b"<",
    b"</", b"&x;", b"\n", b"=", b"'", b'"', b"\x1b]0;x\x07",
)  # fmt: skip
_NUMBERS: Final = tuple(
    struct.pack(kind, value)
    for kind, values in (
        ("<B", (0, 1, 127, 255)), ("<H", (0, 0x7FFF, 0xFFFF)), ("<I", (0, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 28)),
        ("<Q", (0, 1 << 32, 1 << 62, (1 << 64) - 1)), ("<d", (float("nan"), float("inf"), 1e308, 1e-320)),
    )
    for value in values
)  # fmt: skip


def spoil(data: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    """Return an input with one to four things wrong.

    Args:
        data: a good one.
        others: where pieces may come from.
        draw: decides.
    """
    for _ in range(draw.choice((1, 1, 1, 2, 3, 4))):
        data = draw.choice(_WAYS)(data, others, draw)
    return data


def spoil_word(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    """Put another number or word in the place of one."""
    words = [*_WORD.finditer(data)]
    if not words:
        return data
    word = draw.choice(words)
    return data[: word.start()] + draw.choice(_WORDS) + data[word.end() :]


def _flip(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    if not data:
        return data
    at = draw.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << draw.randrange(8)]) + data[at + 1 :]


def _overwrite(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    at, number = draw.randrange(len(data) + 1), draw.choice(_NUMBERS)
    return data[:at] + number + data[at + len(number) :]


def _insert(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    at = draw.randrange(len(data) + 1)
    return data[:at] + draw.choice(_PIECES) + data[at:]


def _cut(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    at = draw.randrange(len(data) + 1)
    return data[:at]


def _remove(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    at = draw.randrange(len(data) + 1)
    return data[:at] + data[at + draw.randrange(64) :]


def _double(data: bytes, _others: Sequence[bytes], draw: random.Random) -> bytes:
    at = draw.randrange(len(data) + 1)
    piece = data[at : at + draw.randrange(1, 200)]
    return data[:at] + piece * draw.choice((2, 2, 3, 20)) + data[at + len(piece) :]


def _join(data: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    other = draw.choice(others)
    return data[: draw.randrange(len(data) + 1)] + other[draw.randrange(len(other) + 1) :]


_WAYS: Final = (spoil_word, spoil_word, spoil_word, _flip, _overwrite, _insert, _cut, _remove, _double, _join)
