"""Draws a run as a film in an MP4 file. The only module that knows PyAV."""

from __future__ import annotations

import io
from itertools import chain, repeat
from typing import Final

import av

from soter.record.tracks import RunTracks
from soter.report.caption import Caption
from soter.report.film import MOST_S, STAYS_S, frames_of

FPS: Final = 25


def draw_mp4(tracks: RunTracks, caption: Caption | None = None, most_s: float = MOST_S) -> bytes:
    """Return a run as the content of an MP4 file, H.264, that lasts at most `most_s`."""
    frames = frames_of(tracks, caption or Caption(), FPS, most_s)
    last = next(frames)
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        stream = container.add_stream("h264", rate=FPS, options={"crf": "20", "preset": "veryfast"})
        stream.width, stream.height = last.size
        # The format that every browser and every player takes.
        stream.pix_fmt = "yuv420p"
        for image in chain(frames, repeat(last, round(FPS * STAYS_S))):
            container.mux(stream.encode(av.VideoFrame.from_image(image)))
        container.mux(stream.encode(None))
    return buffer.getvalue()
