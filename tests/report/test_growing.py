"""The page of a run that goes on: its parts make up the whole, however the run was cut into parts."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from soter.record.content import RecordedTick
from soter.record.reader import Recording
from soter.report.page import extract
from soter.report.page.html import GrowingPage, make_page
from tests.record.helpers import recorded
from tests.report.unpacked import Unpacked, of_page

TURN = 2.0 * np.pi


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes in which a lot happens, violations too."""
    path = tmp_path_factory.mktemp("pages") / "run.mcap"
    fault = {"kind": "bias", "x_m": 0.2, "start_s": 20.0, "every_s": 1.5, "duration_s": 0.1, "declared": False}
    modules = ["collision", "obstacle", "battery"]
    recorded(path, duration_s=120.0, seed=4, targets="hostile", rta__modules=modules, fault=[fault])
    return path


class Viewer:
    """What an open page knows after the parts that it has heard."""

    def __init__(self) -> None:
        self.columns: dict[str, list[float]] = {}
        self.rows: dict[str, list[Any]] = {}
        self.last: dict[str, Any] = {}

    def hear(self, data: str) -> None:
        part = Unpacked(data)
        self.last = part.document
        self._take("", part, part.document)

    def _take(self, place: str, part: Unpacked, value: Any) -> None:
        """Find columns and rows wherever they stand; columns are named by numbers where a page has numbers."""
        if isinstance(value, dict) and value.keys() == {"since", "rows"}:
            self.rows[place] = self.rows.get(place, [])[: value["since"]] + value["rows"]
        elif isinstance(value, dict):
            for name, each in value.items():
                self._take(f"{place}.{name}", part, each)
        elif isinstance(value, list) and place in (".robots", *(f".robots[{at}].modules" for at in range(9))):
            for at, each in enumerate(value):
                self._take(f"{place}[{at}]", part, each)
        elif place.startswith(".robots") and place.rpartition(".")[2] in COLUMNS:
            since = part.document["columns"][value]["since"]
            known = self.columns.get(place, [])
            assert since <= len(known)
            self.columns[place] = known[:since] + part.column(value).tolist()


COLUMNS = {"timeS", "xM", "yM", "headingRad", "bucketS", "low", "high", "reach", "beginS", "endS", "byAc", "begin"}


def grown(path: Path, seed: str) -> Viewer:
    """A viewer who has heard all of a recording, in parts of any length."""
    recording = Recording(path)
    page, viewer, draw = GrowingPage(recording), Viewer(), random.Random(seed)
    waiting: list[RecordedTick] = []
    for tick in recording.ticks():
        waiting.append(tick)
        if draw.random() < 0.02:
            viewer.hear(page.add(waiting, goes_on=True))
            waiting = []
    viewer.hear(page.add(waiting, goes_on=False))
    return viewer


def at_once(page: str) -> Viewer:
    """A viewer who opens a page."""
    viewer = Viewer()
    text = page.partition('id="recording"')[2].partition(">")[2].partition("<")[0]
    viewer.hear(text)
    return viewer


def assert_same(one: Viewer, other: Viewer) -> None:
    assert one.rows == other.rows
    assert one.columns.keys() == other.columns.keys()
    assert len(one.columns) > 30
    for place, values in one.columns.items():
        if place.endswith("headingRad"):
            turns = (np.asarray(values) - np.asarray(other.columns[place])) / TURN
            assert turns == pytest.approx(np.rint(turns), abs=1e-3), place
        else:
            assert values == pytest.approx(other.columns[place], abs=1e-9, nan_ok=True), place


@pytest.mark.parametrize("seed", ["one", "two"])
def test_parts_make_up_the_page_of_the_recording(path: Path, seed: str) -> None:
    viewer = grown(path, seed)
    wanted = at_once(make_page(Recording(path)))
    assert_same(viewer, wanted)
    for name in ("title", "firstS", "lastS", "truth", "faults", "thinned", "summary", "goesOn"):
        assert viewer.last[name] == wanted.last[name], name
    assert viewer.last["truth"]["violations"]
    assert of_page(make_page(Recording(path))).document["truth"] == viewer.last["truth"]


def test_a_long_run_is_thinned_out_on_the_way(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extract, "MOST_POSES", 400)
    monkeypatch.setattr(extract, "MOST_BUCKETS", 50)
    viewer = grown(path, "long")
    assert viewer.last["thinned"] == {"tickS": 0.05, "poseTicks": 16, "bucketTicks": 64}
    # The same as if it had been known from the beginning how long it would be.
    monkeypatch.setattr(extract, "fewest_steps", lambda count, most: 16 if most == 400 else 64)
    wanted = at_once(make_page(Recording(path)))
    assert_same(viewer, wanted)
    content = Recording(path).content()
    for at, series in enumerate(content.series.values()):
        assert viewer.columns[f".robots[{at}].poses.timeS"][-1] == pytest.approx(series.time_s[-1])


def test_who_comes_late_sees_what_the_others_see(path: Path) -> None:
    recording = Recording(path)
    ticks = list(recording.ticks())
    page, early = GrowingPage(recording), Viewer()
    early.hear(page.add(ticks[:500], goes_on=True))
    late = at_once(page.whole("stream?after=1", goes_on=True))
    assert_same(early, late)
    rest = page.add(ticks[500:], goes_on=False)
    early.hear(rest)
    late.hear(rest)
    assert_same(early, late)
    assert_same(late, at_once(make_page(recording)))


def test_a_run_that_goes_on_is_not_called_safe(path: Path) -> None:
    recording = Recording(path)
    document = Unpacked(GrowingPage(recording).add(list(recording.ticks())[:20], goes_on=True)).document
    assert document["truth"]["known"] == "goes on"
    assert document["goesOn"] is True


def test_only_the_page_of_a_run_that_goes_on_may_ask_for_anything(path: Path) -> None:
    recording = Recording(path)
    page = GrowingPage(recording)
    page.add(list(recording.ticks())[:20], goes_on=True)
    live, kept = page.whole("stream?run=a&after=1", goes_on=True), make_page(recording)
    assert "connect-src 'self'\"" in live
    assert 'data-stream="stream?run=a&amp;after=1"' in live
    assert "connect-src" not in kept
    assert "EventSource" not in kept
