"""Films of runs: how long they take, and what is seen to move."""

from __future__ import annotations

import io
from fractions import Fraction
from itertools import pairwise

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from soter.record.tracks import RunTracks
from soter.report import mp4
from soter.report.caption import Caption
from soter.report.film import GIF_FPS, MOST_S, SPEED, STAYS_S, draw_gif, frames_of, length_s
from tests.report.conftest import make_run


@pytest.mark.parametrize(
    ("run_s", "most_s", "expected"),
    [(60.0, MOST_S, 60.0 / SPEED), (600.0, MOST_S, MOST_S), (7200.0, MOST_S, MOST_S), (7200.0, 120.0, 120.0)],
)
def test_a_film_is_ten_times_as_fast_as_the_run_or_as_much_faster_as_it_takes(
    run_s: float, most_s: float, expected: float
) -> None:
    assert length_s(run_s, most_s) == expected


def test_robots_move_from_frame_to_frame_and_the_whole_run_is_first(run: RunTracks) -> None:
    frames = [np.asarray(each) for each in frames_of(run, Caption(), 4, MOST_S)]
    assert len(frames) == 1 + round(4 * 9.0 / SPEED)
    assert all((one != other).any() for one, other in pairwise(frames))
    # The veil over the time lines, at their right end, is there until the last moment.
    dark = [int((frame[900:1140, 1400:1550] < 128).sum()) for frame in frames]
    assert dark[0] > dark[1]


@pytest.mark.parametrize("robots", [1, 6])
def test_a_gif_plays_at_its_rate_and_stays_at_the_end(robots: int) -> None:
    with Image.open(io.BytesIO(draw_gif(make_run(robots), None, 0.3))) as film:
        assert film.size == (800, 600)
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
    assert durations == [1000 // GIF_FPS] * 3 + [1000 * STAYS_S]


def test_an_mp4_is_what_every_player_takes(run: RunTracks, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mp4, "FPS", 5)
    with av.open(io.BytesIO(mp4.draw_mp4(run, None, 0.4))) as film:
        (stream,) = film.streams.video
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height) == (1600, 1200)
        assert stream.average_rate == Fraction(5)
        assert stream.frames == 2 + 5 * STAYS_S


def test_a_run_that_hardly_began_is_a_film_too() -> None:
    assert draw_gif(make_run(1, "0")).startswith(b"GIF89a")
