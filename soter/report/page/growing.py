"""The page of a run that goes on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from soter.record.content import Content, RecordedTick
from soter.record.reader import Recording
from soter.report.page import extract
from soter.report.page.extract import Document
from soter.report.page.html import page_of
from soter.report.page.story import Story


class GrowingPage:
    """A run up to now, as a page for who comes late; and what of it is new, for pages that are open."""

    def __init__(self, recording: Recording) -> None:
        self._recording: Final = recording
        self._content: Final = Content.of(recording.about)
        self._story: Final = Story(recording.about, recording.workspace())

    def add(self, ticks: Sequence[RecordedTick], *, goes_on: bool) -> str:
        """Add ticks; return the data that take an open page from what was added before to what there is now."""
        for tick in ticks:
            self._content.add(tick)
        self._story.add(self._content)
        self._content.forget_series()
        self._story.thin_out(extract.MOST_POSES, extract.MOST_BUCKETS)
        return Document(self._story, self._recording, self._content, news=True, goes_on=goes_on).packed()

    def whole(self, stream: str, *, goes_on: bool) -> str:
        """Return the page of all that was added up to now.

        Args:
            stream: where it hears of what comes next, as an address on the same server.
            goes_on: whether anything may.
        """
        document = Document(self._story, self._recording, self._content, goes_on=goes_on)
        return page_of(document.title, document.packed(), stream)
