"""Draws a run as a film: its picture, in which the robots move."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import chain
from typing import Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from soter.record.tracks import RunTracks
from soter.report.caption import Caption
from soter.report.ground import INK, styled
from soter.report.picture import make_figure
from soter.report.plan import draw_ways
from soter.report.strokes import end_s, time_unit, until

MOST_S: Final = 60.0
"""Longest film by default."""

SPEED: Final = 10.0
"""Speed of a film relative to the run, unless the film would be too long."""

TRAIL_S: Final = 60.0
"""Length of the ways drawn behind the robots, in the run's time."""

STAYS_S: Final = 3.0
"""How long the last frame stays, which is the picture of the whole run."""

GIF_FPS: Final = 10
_GIF_PART: Final = 2
_COLOURS: Final = 256


def length_s(run_s: float, most_s: float = MOST_S) -> float:
    """Return the length of a run's film: `SPEED` times as fast, or faster if it would take longer than `most_s`."""
    return min(run_s / SPEED, most_s)


def draw_gif(tracks: RunTracks, caption: Caption | None = None, most_s: float = MOST_S) -> bytes:
    """Return a run as the content of a GIF file that lasts at most `most_s`."""
    frames = frames_of(tracks, caption or Caption(), GIF_FPS, most_s)
    # The first frame is the whole run, has every colour, and is shown last. An octree keeps the colours of thin
    # lines, where a median cut prefers shades of the background.
    last = next(frames).reduce(_GIF_PART)
    palette = last.quantize(_COLOURS, method=Image.Quantize.FASTOCTREE)
    smaller = (each.reduce(_GIF_PART) for each in frames)
    quantised = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in chain(smaller, [last])]
    buffer = io.BytesIO()
    quantised[0].save(
        buffer, format="GIF", save_all=True, append_images=quantised[1:], loop=0, optimize=True,
        duration=[1000 // GIF_FPS] * (len(quantised) - 1) + [round(1000 * STAYS_S)],
    )  # fmt: skip
    return buffer.getvalue()


def frames_of(run: RunTracks, caption: Caption, per_s: int, most_s: float) -> Iterator[Image.Image]:
    """Yield the picture of the whole run, then `per_s` moments of it for each second of a film of at most `most_s`.

    All that does not move is drawn once. The time lines are those of the whole run, veiled after the moment.
    """
    end = end_s(run)
    film_s = length_s(end, most_s)
    count = max(2, round(film_s * per_s))
    times = f"{end / film_s:.0f} times as fast" if film_s > 0.0 else ""
    with styled():
        whole = FigureCanvasAgg(make_figure(run, caption))
        whole.draw()
        yield _image(whole)
        canvas = FigureCanvasAgg(make_figure(run, caption, ways=False))
        canvas.draw()
        plan, _, *rows = canvas.figure.axes
        place = canvas.copy_from_bbox(canvas.figure.bbox)
        for index in range(count):
            moment_s = end * (index + 1) / count
            canvas.restore_region(place)
            moving = draw_ways(plan, until(run, moment_s), moment_s - TRAIL_S, f"{_clock(moment_s)}, {times}")
            for each in moving:
                plan.draw_artist(each)
            for axes in rows:
                moving += _veil(axes, moment_s, end)
            yield _image(canvas)
            for each in moving:
                each.remove()


def _veil(axes: Axes, moment_s: float, end: float) -> list[Artist]:
    """Veil the part of a time line after a moment."""
    unit_s, _ = time_unit(end)
    now, last = moment_s / unit_s, end / unit_s
    veil = axes.axvspan(now, last, fc="white", alpha=0.8, ec="none", zorder=8)
    line = axes.axvline(now, color=INK, lw=1.0, zorder=9)
    for each in (veil, line):
        axes.draw_artist(each)
    return [veil, line]


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _image(canvas: FigureCanvasAgg) -> Image.Image:
    drawn = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba(), "raw", "RGBA", 0, 1)
    return drawn.convert("RGB")
