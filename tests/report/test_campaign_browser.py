"""The pages of campaigns and of recordings side by side, in a real browser; see `test_browser.py`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from soter.campaign.plan import load_campaign
from soter.campaign.report.beside import make_beside
from soter.campaign.report.page import make_page
from soter.campaign.session import run_campaign
from soter.campaign.store import Store
from soter.record.reader import Recording
from tests.campaign.here import Here, write
from tests.record.helpers import recorded
from tests.report.chromium import DESKTOP, NEEDED, looks_wrong, until

pytestmark = NEEDED

LONG = "a-part-whose-name-takes-more-room-than-there-is"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a campaign: settings with long names, and runs that break rules."""
    folder = tmp_path_factory.mktemp("campaign")
    path = write(
        folder,
        {"name": LONG, "seeds": {"count": 2}, "grid": {"targets": ["grid", "hostile"]}},
        {"set": {"robots": 1, "rta.enabled": False, "targets": "hostile", "duration_s": 30.0}},
    )
    read = load_campaign(path)
    with Store(folder / "kept.sqlite", write=True) as kept:
        kept.describe({"path": str(path), "title": "A & B", "text": read.text, "sources": read.sources})
        run_campaign(read, kept, Here())
        (folder / "page.html").write_text(make_page(kept, {}, folder), encoding="utf-8")
    return folder / "page.html"


@contextmanager
def silent(browser: Any, path: Path, width: int = DESKTOP["width"], scheme: str = "light") -> Iterator[Any]:
    """A page that may say nothing."""
    context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme, offline=True)
    page = context.new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda failure: said.append(str(failure)))
    page.goto(path.as_uri())
    yield page
    context.close()
    assert said == []


@pytest.mark.parametrize("width", [390, 820, 1280, 1920])
def test_labels_stand_beside_their_rows_at_any_size(browser: Any, campaign: Path, width: int) -> None:
    with silent(browser, campaign, width) as page:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.reload()
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert looks_wrong(page) == []
            off = page.evaluate(
                """() => [...document.querySelectorAll(".dots")].flatMap((dots) => {
                    const labels = [...dots.querySelectorAll("li")].map((each) => each.getBoundingClientRect());
                    const middles = [...dots.querySelectorAll(".middle")].map((each) => each.getBoundingClientRect());
                    return labels.map((label, at) => ({
                        down: Math.abs((label.top + label.bottom) / 2 - (middles[at].top + middles[at].bottom) / 2),
                        over: label.right - middles[at].left,
                    }));
                })"""
            )
            assert off
            assert all(each["down"] < 3.0 and each["over"] <= 0.0 for each in off)


def test_a_column_sorts_by_numbers_both_ways(browser: Any, campaign: Path) -> None:
    with silent(browser, campaign) as page:
        runs = page.locator(".card").last
        shown = "(card) => [...card.querySelectorAll('tbody tr')].map((row) => parseFloat(row.cells[6].textContent))"
        button = runs.locator("th button", has_text="least margin")
        button.click()
        margins = runs.evaluate(shown)
        assert margins == sorted(margins)
        assert margins[0] < 0.0 < margins[-1]
        button.click()
        assert runs.evaluate(shown) == sorted(margins, reverse=True)
        assert runs.locator("th[aria-sort=descending]").count() == 1


def test_recordings_beside_each_other_are_in_step(browser: Any, tmp_path: Path) -> None:
    paths = [tmp_path / f"{seed}.mcap" for seed in (1, 2)]
    for seed, path in enumerate(paths, start=1):
        recorded(path, duration_s=20.0, seed=seed)
    (tmp_path / "beside.html").write_text(make_beside([Recording(path) for path in paths]), encoding="utf-8")
    frames = "[...document.querySelectorAll('iframe')].map((each) => each.contentWindow.soter)"
    with silent(browser, tmp_path / "beside.html") as page:
        until(page, f"{frames}.every((each) => each?.openedMs)")
        for moved, other, time_s in ((0, 1, 7.5), (1, 0, 12.25)):
            page.evaluate(f"(timeS) => {frames}[{moved}].player.seek(timeS)", time_s)
            until(page, f"{frames}[{other}].player.timeS === {time_s}")
        page.click("#theme")
        until(page, f"{frames}.every((each) => each.page.style.dark)")
        for frame in page.frames[1:]:
            plan, player = (frame.locator(name).bounding_box() for name in ("#plan", "#transport"))
            assert plan["y"] + plan["height"] <= player["y"]


def test_plans_beside_each_other_have_one_scale_where_both_can_be_seen(browser: Any, tmp_path: Path) -> None:
    sides_m = {"small": 5, "wide": 9, "huge": 60}
    for name, side_m in sides_m.items():
        (tmp_path / f"{name}.toml").write_text(f"""\
[fence]
polygon = [[0, 0], [{side_m}, 0], [{side_m}, 4], [0, 4]]
[[station]]
x_m = 1.0
y_m = 1.0
side_m = 0.4
""")
        recorded(tmp_path / f"{name}.mcap", duration_s=2.0, workspace=str(tmp_path / f"{name}.toml"))
    scales = "[...document.querySelectorAll('iframe')].map((each) => each.contentWindow.soter?.page?.plan.fit)"
    for one, other, same in (("small", "wide", True), ("small", "huge", False)):
        page_file = tmp_path / f"{other}.html"
        both = [Recording(tmp_path / f"{name}.mcap") for name in (one, other)]
        page_file.write_text(make_beside(both), encoding="utf-8")
        with silent(browser, page_file) as page:
            until(page, f"{scales}.every((each) => each)")
            if same:
                until(page, f"new Set({scales}).size === 1")
                page.set_viewport_size({"width": 1000, "height": 700})
                until(page, f"new Set({scales}).size === 1")
            else:
                first, second = page.evaluate(scales)
                assert first > 3.0 * second
