"""The picture of a run as it went on: the same picture at many moments, as a GIF."""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import replace
from typing import Final

from PIL import Image

from soter.record.tracks import RunTracks
from soter.report.caption import Caption
from soter.report.picture import draw_png
from soter.report.strokes import end_s

FRAMES: Final = 96
WIDTH_PX: Final = 800
FRAME_MS: Final = 80
LAST_FRAME_MS: Final = 3000
"""The last moment is the picture of the whole run, and stays."""

_COLOURS: Final = 256


def draw_gif(tracks: RunTracks, caption: Caption | None = None) -> bytes:
    """Return a run as the content of a GIF file: moments at equal distances, and the whole run at the end."""
    end = end_s(tracks)
    moments = [end * (index + 1) / FRAMES for index in range(FRAMES - 1)]
    words = caption or Caption()
    frames = [_frame(draw_png(tracks, _at(tracks, words, moment), moment)) for moment in moments]
    frames.append(_frame(draw_png(tracks, words)))
    # One palette for all: that of the last frame, which has every colour that there is. An octree keeps colours of
    # thin lines, which a median cut gives away for shades of the background.
    palette = frames[-1].quantize(_COLOURS, method=Image.Quantize.FASTOCTREE)
    quantised = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    buffer = io.BytesIO()
    quantised[0].save(
        buffer, format="GIF", save_all=True, append_images=quantised[1:], loop=0, optimize=True,
        duration=[FRAME_MS] * (FRAMES - 1) + [LAST_FRAME_MS],
    )  # fmt: skip
    return buffer.getvalue()


def _at(tracks: RunTracks, caption: Caption, moment_s: float) -> Caption:
    """Return the words with the disengagements that there had been at a moment."""
    counted = Counter(
        switch.module
        for switch in tracks.switches
        if switch.before is None and switch.after is not None and switch.time_s <= moment_s
    )
    return replace(caption, disengagements={name: counted[name] for name in caption.disengagements})


def _frame(png: bytes) -> Image.Image:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    return picture.resize((WIDTH_PX, picture.height * WIDTH_PX // picture.width), Image.Resampling.LANCZOS)
