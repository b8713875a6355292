"""A recording is read while it grows, and what is read is what stands there in the end."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from soter.record.follow import GrowingRecording
from soter.record.reader import BadRecording, Recording
from tests.live.growing import Growing
from tests.record.helpers import every_message


def pieces(seed: str, last: float = 1.0) -> list[float]:
    """Where a file that grows stands from time to time, the end first."""
    draw = random.Random(seed)
    return sorted((draw.uniform(0.0, last) for _ in range(40)), reverse=True)


def followed(growing: Growing, parts: list[float]) -> GrowingRecording:
    """A recording that grows whenever there is nothing left to read."""
    return GrowingRecording(growing.path, lambda: not parts, lambda: growing.to(parts.pop()))


def test_what_is_read_while_it_grows_is_what_is_there_in_the_end(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    recording = followed(growing, [1.0, *pieces("grows")])
    assert list(recording.ticks()) == list(Recording(whole).ticks())
    assert recording.result == Recording(whole).result
    assert not recording.truncated


def test_messages_for_the_eye_are_passed_on_as_they_stand_there(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    raw = [(each.topic, each.schema, each.definition, each.data) for each in followed(growing, [1.0, 0.3]).raw()]
    assert raw == list(every_message(whole))


def test_a_recording_that_ends_in_the_middle_is_cut_off(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    recording = followed(growing, [0.7, *pieces("ends", last=0.7)])
    known_before = recording.truncated
    ticks = [tick for tick in recording.ticks() if tick.robots]
    assert 0 < len(ticks) < 1200
    assert ticks == list(Recording(whole).ticks())[: len(ticks)]
    assert (known_before, recording.truncated) == (False, True)
    assert recording.result is None


def test_one_that_ends_before_it_says_what_it_is_is_refused(whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    with pytest.raises(BadRecording, match=r"cut off|no MCAP file"):
        followed(growing, [20.0 / whole.stat().st_size])
