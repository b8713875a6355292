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

LIVE_PROGRAMS: Final = ("data.js", "plan.js", "charts.js", "panels.js", "live.js", "page.js")
"""The same with what hears of a run that goes on."""


def make_page(recording: Recording) -> str:
    """Return the page of a recording.

    Raises:
        BadRecording: it is damaged, or lacks what a page shows.
        ConfigError: its workspace is not allowed.
    """
    title, data = extract(recording)
    return page_of(title, data)


def page_of(title: str, data: str, stream: str = "") -> str:
    """Return a page.

    Args:
        title: in its head.
        data: of its run.
        stream: for a run that goes on, where to hear of it: an address on the server that the page comes from. Only
            then may a page ask for anything.
    """
    programs = "\n".join(f"<script>\n{_asset(name)}</script>" for name in (LIVE_PROGRAMS if stream else PROGRAMS))
    return Template(_asset("page.html")).substitute(
        title=escape(title),
        style=_asset("page.css"),
        programs=programs,
        data=data,
        connections="; connect-src 'self'" if stream else "",
        stream=f' data-stream="{escape(stream)}"' if stream else "",
    )


def _asset(name: str) -> str:
    return files("soter.report.page").joinpath("assets", name).read_text(encoding="utf-8")
