"""Puts a page together: template, style, programs and data in one file that loads nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Final

from soter.record.content import Content, RecordedTick
from soter.record.reader import Recording
from soter.report.page import extract
from soter.report.page.story import Story

PROGRAMS: Final = ("data.js", "plan.js", "charts.js", "panels.js", "tip.js", "page.js")
"""The programs of a page, in the order in which they run."""

LIVE_PROGRAMS: Final = (*PROGRAMS[:-1], "live.js", PROGRAMS[-1])
"""The same with the one that receives the news of a run that goes on."""

_SKIPS: Final = """\
<a class="skip" href="#plan-heading">Skip to the plan</a>
<a class="skip" href="#play">Skip to the playback, which follows the rest of the page</a>
"""


def make_page(recording: Recording) -> str:
    """Return the page of a recording.

    Raises:
        BadRecording: the recording is damaged, or lacks data that a page shows.
        ConfigError: its workspace is not allowed.
    """
    return page_of(*extract.extract(recording))


class GrowingPage:
    """The page of a run that goes on: the whole of it for new viewers, and the news for open pages."""

    def __init__(self, recording: Recording) -> None:
        self._recording: Final = recording
        self._content: Final = Content.of(recording.about)
        self._story: Final = Story(recording.about, recording.workspace())

    def add(self, ticks: Sequence[RecordedTick], *, goes_on: bool) -> str:
        """Add ticks; return the data that bring an open page up to date."""
        for tick in ticks:
            self._content.add(tick)
        self._story.add(self._content)
        self._content.forget_series()
        self._story.thin_out(extract.MOST_POSES, extract.MOST_BUCKETS)
        return extract.Document(self._story, self._recording, self._content, news=True, goes_on=goes_on).packed()

    def whole(self, stream: str, *, goes_on: bool) -> str:
        """Return the page of all ticks added up to now; `stream` is the address of its news on the same server."""
        document = extract.Document(self._story, self._recording, self._content, goes_on=goes_on)
        return page_of(document.title, document.packed(), stream)


def page_of(title: str, data: str, stream: str = "") -> str:
    """Return a page.

    `stream` is, for a run that goes on, the address of its news on the page's own server. Only with one may a page
    make requests.
    """
    body = Template(_asset("run.html")).substitute(
        data=data, stream=f' data-stream="{escape(stream)}"' if stream else ""
    )
    return frame(
        title, "", body, style=_asset("page.css"), programs=map(_asset, LIVE_PROGRAMS if stream else PROGRAMS),
        skips=_SKIPS, tools=_asset("tools.html"), connections="; connect-src 'self'" if stream else "",
    )  # fmt: skip


def frame(
    title: str,
    subtitle: str,
    body: str,
    *,
    style: str,
    programs: Iterable[str],
    skips: str = "",
    tools: str = "",
    connections: str = "",
) -> str:
    """Return a page with the head common to all pages.

    Args:
        title: the page's title.
        subtitle: the line below the title.
        body: the rest of the page, as HTML.
        style: CSS.
        programs: JavaScript, in the order in which they run.
        skips: links for readers without a mouse, as HTML.
        tools: buttons beside the one for the theme, as HTML.
        connections: the part of the page's content security policy that allows requests; none by default.
    """
    return Template(_asset("page.html")).substitute(
        title=escape(title), subtitle=escape(subtitle), body=body, style=style, skips=skips, tools=tools,
        programs="\n".join(f"<script>\n{each}</script>" for each in programs), connections=connections,
    )  # fmt: skip


def _asset(name: str) -> str:
    return files("soter.report.page").joinpath("assets", name).read_text(encoding="utf-8")
