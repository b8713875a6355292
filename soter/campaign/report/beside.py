"""Recordings side by side: one page in which all of them play in step."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Any, Final

from soter.campaign.report.page import card, page_of, table
from soter.record.reader import Recording
from soter.report.page.html import make_page
from soter.sdk import RULES

FIGURES: Final = (
    "status", "backend", "engine", "planner", "ac", "seed", "duration_s",
    *(f"violations.{rule}" for rule in RULES), *(f"min_margin.{rule}" for rule in RULES),
    "ac_share", "disengagements_total", "targets_reached", "longest_stall_s", "no_progress_s",
)  # fmt: skip


def make_beside(recordings: Sequence[Recording]) -> str:
    """Return one page of recordings: their figures, and each one's own page in a frame.

    Raises:
        BadRecording: one is damaged, or lacks what a page shows.
        ConfigError: a workspace is not allowed.
    """
    names = [recording.path.name for recording in recordings]
    results = [json.loads(recording.result_json or b"{}") for recording in recordings]
    rows = [[name, *(_shown(result, name) for result in results)] for name in FIGURES]
    rows.append(["trace", *(result.get("trace_sha256", "-")[:12] for result in results)])
    # The text of a frame's page is an attribute of this one, so that all is one file.
    frames = "".join(
        f'<iframe title="{escape(name)}" srcdoc="{escape(make_page(recording))}"></iframe>'
        for name, recording in zip(names, recordings, strict=True)
    )
    parts = [f'<section class="frames">{frames}</section>', card("Figures", table(["figure", *names], rows))]
    return page_of(" beside ".join(names), "They play in step: whichever is moved, the others follow.", parts)


def _shown(result: dict[str, Any], name: str) -> str:
    value: Any = result
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return "-" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value)
