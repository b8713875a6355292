"""The picture of a run as it went on: the same picture at many moments, as a GIF."""

from __future__ import annotations

import io
from typing import Final

from PIL import Image

from soter.record.tracks import RunTracks
from soter.report.caption import Caption
from soter.report.picture import draw_png
from soter.report.strokes import end_s

FRAMES: Final = 48
WIDTH_PX: Final = 800
FRAME_MS: Final = 160
LAST_FRAME_MS: Final = 3000
"""The last moment is the picture of the whole run, and stays."""

_COLOURS: Final = 64


def draw_gif(tracks: RunTracks, caption: Caption | None = None) -> bytes:
    """Return a run as the content of a GIF file: moments at equal distances, and the whole run at the end."""
    end = end_s(tracks)
    moments = [end * (index + 1) / FRAMES for index in range(FRAMES - 1)]
    frames = [_frame(draw_png(tracks, caption, moment)) for moment in moments]
    frames.append(_frame(draw_png(tracks, caption)))
    # One palette for all: that of the last frame, which has every colour that there is.
    palette = frames[-1].quantize(_COLOURS)
    quantised = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    buffer = io.BytesIO()
    quantised[0].save(
        buffer, format="GIF", save_all=True, append_images=quantised[1:], loop=0, optimize=True,
        duration=[FRAME_MS] * (FRAMES - 1) + [LAST_FRAME_MS],
    )  # fmt: skip
    return buffer.getvalue()


def _frame(png: bytes) -> Image.Image:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    return picture.resize((WIDTH_PX, picture.height * WIDTH_PX // picture.width), Image.Resampling.LANCZOS)
