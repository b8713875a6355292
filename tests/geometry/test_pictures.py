"""Pictures of maps: what cannot be read of them, and shades and palettes that libraries seldom write."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from soter.errors import ConfigError
from soter.geometry.reading import read_workspace
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


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        (b"GIF89a", "it is no picture of a kind that is read"),
        (b"", "it is no picture of a kind that is read"),
        (b"P5 160000000000 12 255\n", "it is cut off, or spoilt in its middle"),
        (b"P5 16 12 255\n" + bytes(100), "it is cut off, or spoilt in its middle"),
    ],
)
def test_pictures_that_cannot_be_read_are_refused_in_plain_words(picture: bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        read_workspace(written(tmp_path, picture), inhabited=False)
    file, named = tmp_path / "map.yaml", tmp_path / "map.pgm"
    assert str(refused.value) == f"{file}: image: {named}: {said}, allowed: a whole PGM or PNG"


PLAIN = b"P2 3 3\n# of 4 x 4\n255\n" + b"254 " * 9


@pytest.mark.parametrize("head", [b"P5 3 3 255\n" + b"\xfe" * 9, b"P5 3 3 65535\n" + b"\xfe" * 18, PLAIN])
def test_a_picture_ends_where_its_head_says(head: bytes, tmp_path: Path) -> None:
    for end in (b"", b"\n"):
        assert not cells(written(tmp_path, head + end)).any()
    with pytest.raises(ConfigError, match=r"map.pgm: it goes on after the 3 x 3 pixels .* allowed: a PGM of one"):
        cells(written(tmp_path, head + b"254"))
