"""Puts a page together: template, style, programs and data in one file that loads nothing."""

from __future__ import annotations

from html import escape
from importlib.resources import files
from string import Template
from typing import Final

from soter.record.reader import Recording
from soter.report.page.extract import extract

PROGRAMS: Final = ("data.js", "plan.js", "charts.js", "panels.js", "page.js")
"""In the order in which they run."""


def make_page(recording: Recording) -> str:
    """Return the page of a recording.

    Raises:
        BadRecording: it is damaged, or lacks what a page shows.
        ConfigError: its workspace is not allowed.
    """
    title, data = extract(recording)
    programs = "\n".join(f"<script>\n{_asset(name)}</script>" for name in PROGRAMS)
    return Template(_asset("page.html")).substitute(
        title=escape(title), style=_asset("page.css"), programs=programs, data=data
    )


def _asset(name: str) -> str:
    return files("soter.report.page").joinpath("assets", name).read_text(encoding="utf-8")
