"""The live page in a real browser, during real runs: it follows, goes back, returns, and sees the end.

It needs Chromium and Playwright, as `test_browser.py` does.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import pytest

from soter.live.event_buffer import EventBuffer, FellBehind
from soter.live.view import PAGE, LiveView
from soter.live.web import PageScreen
from soter.record.follow import GrowingRecording
from soter.record.reader import Recording
from tests.live.growing import Growing
from tests.project.source import ROOT
from tests.record.helpers import SURVEILLANCE, recorded
from tests.report.chromium import NEEDED, WAIT_S, moment, silent, until
from tests.waiting import wait_until

pytestmark = NEEDED

ENDLESS = (
    "--backend",
    "kinematic",
    "--planner",
    "straight-line",
    "--duration",
    "1e6",
    "--pace",
    "20",
    "--live",
    "--no-record",
    "-q",
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five minutes, whose recording has many chunks."""
    path = tmp_path_factory.mktemp("recordings") / "whole.mcap"
    recorded(path, duration_s=300.0)
    return path


@contextmanager
def running() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A run that goes on until it is interrupted, and the address of its page, once there is something on it."""
    command = [sys.executable, "-m", "soter.cli", "run", str(SURVEILLANCE), *ENDLESS]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
            assert found is not None
            yield process, found[0]
        finally:
            if process.poll() is None:
                process.kill()


def stream_of(page: Any) -> str:
    """What the page listens to."""
    address: str = page.get_attribute("#recording", "data-stream")
    return address


def known_s(page: Any) -> float:
    """The end of what the page knows of the run, in fleet time."""
    return float(page.evaluate("soter.run.lastS"))


def places(page: Any) -> list[tuple[float, float]]:
    return [(robot["xM"], robot["yM"]) for robot in page.evaluate("soter.page.moment.robots")]


def says(text: str) -> str:
    """That the button beside the clock says something, for `until`."""
    return f"document.getElementById('live-state').textContent === '{text}'"


def test_a_run_is_followed_scrubbed_returned_to_and_seen_to_its_end(browser: Any) -> None:
    asked: list[str] = []
    with running() as (process, address):
        until_served(address)
        with silent(browser, address, asked) as page:
            asked.append(urljoin(address, stream_of(page)))
            until(page, says("live"))
            assert "The run goes on" in page.inner_text("#verdict")
            before, began_s = places(page), known_s(page)
            until(page, f"soter.player.following && soter.player.timeS > {began_s}")
            # It is drawn a frame later, and robots may stand for a while.
            wait_until(lambda: places(page) != before)

            # Ten seconds back there still is a disengagement to go back to.
            until(page, "soter.run.events.length && soter.player.timeS > soter.run.events[0] + 11")
            page.keyboard.press("Shift+ArrowLeft")
            until(page, "document.getElementById('live-state').textContent.endsWith('behind live')")
            seen = moment(page)["timeS"]
            until(page, f"soter.run.lastS > {known_s(page)}")
            assert page.evaluate("soter.player.timeS") == seen
            page.keyboard.press("p")
            shown = moment(page)
            assert shown["timeS"] in [each["timeS"] for each in page.evaluate("soter.run.disengagements")]
            rows = page.locator("#rows tr").count()
            until(page, f"document.querySelectorAll('#rows tr').length > {rows}")

            page.click("#live")
            # What the button says is drawn a frame after what the player does.
            until(page, says("live"))
            until(page, f"soter.player.following && soter.player.timeS > {shown['timeS']}")

            os.killpg(process.pid, signal.SIGINT)
            until(page, "!soter.run.goesOn")
            until(page, says("the run has ended: interrupted"))
            assert "No violation" in page.inner_text("#verdict")
            until(page, "soter.player.timeS === soter.run.lastS && !soter.player.following")
            page.keyboard.press("Home")
            assert moment(page)["timeS"] == 0.0
        assert process.wait(30.0) == 130


def until_served(address: str) -> None:
    """Wait until there is more than the notice that the run has not begun."""
    from tests.live.test_view import status_of

    wait_until(lambda: status_of(address) == 200)


def test_what_a_page_has_heard_in_parts_is_what_was_recorded(browser: Any, whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    growing.to(0.1)
    content = Recording(whole).content()
    asked: list[str] = []
    with LiveView(PAGE) as view:
        view.begin(growing.path)
        until_served(view.address)
        with silent(browser, view.address, asked) as page:
            asked.append(urljoin(view.address, stream_of(page)))
            for part in range(2, 21):
                growing.to(part / 20)
                page.wait_for_timeout(20)
            view.close()
            until(page, "!soter.run.goesOn")
            for time_s in (0.0, 77.7, 150.0, 299.0):
                page.evaluate("(timeS) => soter.player.seek(timeS)", time_s)
                index = round(time_s / 0.05)
                for robot in moment(page)["robots"]:
                    series = content.series[robot["id"]]
                    assert robot["xM"] == pytest.approx(series.x_m[index], abs=2e-3)
                    assert robot["yM"] == pytest.approx(series.y_m[index], abs=2e-3)
                    assert robot["driver"] == series.driver[index]
                    for margin in robot["margins"]:
                        wanted = series.margins[margin["name"]][index]
                        assert margin["margin"] == pytest.approx(wanted, abs=1e-3)
            assert page.locator("#rows tr").count() == len(content.disengagements)
            assert page.locator("#margins figure").count() == 4
            assert page.locator("#charges figure").count() == 1


def reloaded(page: Any) -> bool:
    """Whether a page has been loaded anew and is open again."""
    from playwright.sync_api import Error

    try:
        return bool(
            page.evaluate("performance.getEntriesByType('navigation')[0].type === 'reload' && window.soter.openedMs")
        )
    except Error:  # neither the one nor the other: it is being loaded
        return False


def test_a_page_that_has_fallen_behind_begins_anew(
    browser: Any, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    after = EventBuffer.after
    behind: list[int] = []
    falls = threading.Event()

    def first_behind(events: EventBuffer, number: int, limit_s: float) -> tuple[list[bytes], bool]:
        if not behind:
            behind.append(number)
            falls.wait(WAIT_S)
            raise FellBehind
        return after(events, number, limit_s)

    monkeypatch.setattr(EventBuffer, "after", first_behind)
    growing = Growing(whole, tmp_path / "run.mcap")
    growing.to(0.5)
    ended = threading.Event()
    screen = PageScreen(0)

    def wait() -> None:
        screen.pause()
        time.sleep(0.02)

    recording = GrowingRecording(growing.path, ended.is_set, wait)
    showing = threading.Thread(target=lambda: screen.show(recording))
    showing.start()
    try:
        address = f"http://127.0.0.1:{screen.port}/"
        until_served(address)
        asked: list[str] = []
        with silent(browser, address, asked) as page:
            asked += [urljoin(address, stream_of(page)), address]
            falls.set()
            wait_until(lambda: reloaded(page))
            asked.append(urljoin(address, stream_of(page)))
            before_s = known_s(page)
            growing.to(0.9)
            until(page, f"soter.run.lastS > {before_s} && soter.player.following")
    finally:
        ended.set()
        showing.join()
        screen.close()
    assert behind


def test_a_page_whose_server_is_gone_says_so_and_keeps_what_it_knows(browser: Any, whole: Path, tmp_path: Path) -> None:
    growing = Growing(whole, tmp_path / "run.mcap")
    growing.to(0.5)
    with LiveView(PAGE) as view:
        view.begin(growing.path)
        until_served(view.address)
        context = browser.new_context()
        page = context.new_page()
        page.goto(view.address)
        # The first tick alone is served already.
        until(page, "window.soter && window.soter.openedMs && soter.run.lastS > 0")
        os.kill(view.pid, signal.SIGKILL)
        until(page, says("connection lost"))
        page.keyboard.press("Home")
        assert moment(page)["timeS"] == 0.0
        context.close()
