"""A page of recordings side by side, in which all of them play in step."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import PurePath
from typing import Any, Final

from soter.campaign.conditions import looked_up
from soter.campaign.report.page import card, page_of, table
from soter.record.reader import Recording
from soter.report.page.html import make_page

ABOUT: Final = {
    "status": "status", "backend": "backend", "engine": "engine", "ac": "advanced controller", "planner": "planner",
    "seed": "seed", "duration_s": "duration",
}  # fmt: skip
"""Keys of results that describe the run, with their labels."""

FIGURES: Final = {
    "ac_share": "AC in control", "disengagements_total": "disengagements", "targets_reached": "targets reached",
    "longest_stall_s": "longest stall", "longest_without_ac_s": "longest without AC",
    "no_progress_s": "no progress for", "trace_sha256": "trace",
}  # fmt: skip
"""Figures of results besides those of rules, with their labels."""

OF_MISSIONS: Final = ("planner", "targets_reached", "longest_stall_s", "no_progress_s")
"""Keys that have no meaning for a controller's run."""

_LONGEST: Final = 24


def make_beside(recordings: Sequence[Recording]) -> str:
    """Return one page of recordings: their figures, and each one's own page in a frame.

    Raises:
        BadRecording: a recording is damaged, or lacks data that a page shows.
        ConfigError: a workspace is not allowed.
    """
    names = [recording.path.name for recording in recordings]
    results = [json.loads(recording.result_json or b"{}") for recording in recordings]
    # The rules of all recordings: a user's own module may be in some only.
    rules = dict.fromkeys(rule for result in results for rule in result.get("violations") or {})
    counted = {f"violations.{rule}": f"violations: {rule}" for rule in rules}
    margins = {f"min_margin.{rule}": f"least margin: {rule}" for rule in rules}
    rows = [
        [words, *(_shown(result, key) for result in results)]
        for key, words in {**ABOUT, **counted, **margins, **FIGURES}.items()
    ]
    # Each frame's page is an attribute of this one, so that all is one file.
    frames = "".join(
        f'<iframe title="{escape(name)}" srcdoc="{escape(make_page(recording))}"></iframe>'
        for name, recording in zip(names, recordings, strict=True)
    )
    parts = [f'<section class="frames">{frames}</section>', card("Figures", table(["figure", *names], rows))]
    return page_of(" beside ".join(names), "They play in step: whichever is moved, the others follow.", parts)


def _shown(result: dict[str, Any], key: str) -> str:
    value = looked_up(result, key)
    head, _, rule = key.partition(".")
    if value is None and head == "min_margin" and rule in (result.get(head) or {}) and result["violations"][rule]:
        return "not a number"
    if value is None or (key in OF_MISSIONS and result["ac"] != "mission"):
        return "-"
    if key == "ac":
        return f"mission {PurePath(result['does']).name}" if value == "mission" else PurePath(value).name
    if key in ("ac_share", "min_margin.battery"):
        return f"{100.0 * value:.1f} %"
    if key.startswith("min_margin."):
        return f"{value:.3f} m"
    return f"{value:g} s" if key.endswith("_s") else str(value)[:_LONGEST]
