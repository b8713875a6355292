"""Pictures of maps that libraries seldom write: shades that stand for nothing, and palettes that are too short."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from soter.errors import ConfigError
from tests.geometry.test_maps import cells, written


def png(bits: int, kind: int, row: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """Return a PNG of 4 x 4 pixels in equal rows; libraries write not all that there are."""
    head = struct.pack(">IIBBBBB", 4, 4, bits, kind, 0, 0, 0)
    parts = [(b"IHDR", head), *chunks, (b"IDAT", zlib.compress((b"\0" + row) * 4)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts
    )


@pytest.mark.parametrize(
    ("bits", "row", "clear"),
    [
        (1, b"\xb0", (0,)),
        (2, b"\xef", (2,)),
        (4, b"\xfe\xff", (14,)),
        (8, b"\xff\xfe\xff\xff", (254,)),
        (16, b"\xff\xff\xff\xfe\xff\xff\xff\xff", (65534,)),
        (8, bytes([255, 255, 255, 255, 255, 254, 255, 255, 255, 255, 255, 255]), (255, 255, 254)),
        (16, bytes.fromhex("ffffffffffff fefefefefefe ffffffffffff ffffffffffff"), (65278,) * 3),
    ],
)
def test_the_shade_that_a_picture_calls_transparent_is_unknown(
    bits: int, row: bytes, clear: tuple[int, ...], tmp_path: Path
) -> None:
    data = png(bits, 0 if len(clear) == 1 else 2, row, (b"tRNS", struct.pack(f">{len(clear)}H", *clear)))
    assert (cells(written(tmp_path, data, "map.png")) == [False, True, False, False]).all()


@pytest.mark.parametrize("palette", [[], [(b"PLTE", bytes([255] * 3))]])
def test_colours_that_a_palette_lacks_are_refused(palette: list[tuple[bytes, bytes]], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"map.png: it has colours that its palette lacks, allowed: a whole PGM or"):
        cells(written(tmp_path, png(8, 3, b"\0\0\1\0", *palette), "map.png"))
    whole = (b"PLTE", bytes([255] * 6))
    assert not cells(written(tmp_path, png(8, 3, b"\0\0\1\0", whole), "map.png")).any()
