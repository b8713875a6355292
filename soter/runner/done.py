"""What a run leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

from soter.record.recorder import RecordingReport
from soter.record.tracks import RunTracks
from soter.runner.result import RunResult


@dataclass(frozen=True)
class Run:
    """What a run leaves behind.

    Attributes:
        result: the figures.
        tracks: where the robots were, and who was in control.
        recording: how its recording went; None if there is none.
    """

    result: RunResult
    tracks: RunTracks
    recording: RecordingReport | None = None
