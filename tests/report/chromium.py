"""Pages in a real browser: Chromium, driven by Playwright. Without them tests of pages were NOT RUN."""

from __future__ import annotations

import importlib.util
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

# The first one has no window to offer, and costs half as much.
NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM = next((found for name in NAMES if (found := shutil.which(name))), None)
NEEDED = [
    pytest.mark.skipif(
        importlib.util.find_spec("playwright") is None,
        reason="NOT RUN: no page was opened, Playwright is not installed (`make browser-test`)",
    ),
    pytest.mark.skipif(
        CHROMIUM is None, reason=f"NOT RUN: no page was opened, there is none of {', '.join(NAMES)} on the PATH"
    ),
]
"""Marks of every test that opens a page."""

LOOKS = Path(__file__).with_name("looks.js").read_text(encoding="utf-8").partition("\n")[2].strip()
WAIT_S = 30.0
DESKTOP = {"width": 1440, "height": 900}


_running: list[Any] = []


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser, without a window. Playwright allows one at a time in a process: whoever comes second shares it."""
    from playwright.sync_api import sync_playwright

    if _running:
        yield _running[0]
        return
    with sync_playwright() as driver:
        # The sandbox cannot be had as root; the page is our own.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        started = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        _running.append(started)
        yield started
        _running.clear()
        started.close()


@contextmanager
def silent(browser: Any, address: str, asked_for: list[str], *, still: bool = False, **options: Any) -> Iterator[Any]:
    """A page in a window of its own; afterwards it must have said nothing, and asked for nothing but what it may.

    Args:
        browser: see `chromium`.
        address: of the page.
        asked_for: what it is to ask for besides itself, filled in by the test.
        still: once it is open, time passes only as `page.clock` says.
        options: of the window.
    """
    context = browser.new_context(**{"viewport": DESKTOP, **options})
    page = context.new_page()
    if still:
        page.clock.install(time=0)
    said: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda failure: said.append(str(failure)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    until(page, "window.soter && window.soter.openedMs")
    if still:
        page.clock.pause_at(60.0)
    yield page
    context.close()
    assert said == []
    assert asked == [address.partition("#")[0], *asked_for]


@contextmanager
def opened(browser: Any, path: Path, fragment: str = "", **options: Any) -> Iterator[Any]:
    """A page in a file, which may ask for nothing."""
    with silent(browser, f"{path.as_uri()}{fragment}", [], **{"offline": True, **options}) as page:
        yield page


def until(page: Any, expression: str) -> None:
    """Wait for something to become true. The page forbids to make programs of texts, so the driver has to ask."""
    deadline_s = time.monotonic() + WAIT_S
    while not page.evaluate(expression):
        assert time.monotonic() < deadline_s, f"it never came true: {expression}"
        page.wait_for_timeout(20)


def moment(page: Any) -> dict[str, Any]:
    """What the page shows, once it has drawn what was asked for."""
    until(page, "soter.page.moment && soter.page.moment.timeS === soter.player.timeS")
    found: dict[str, Any] = page.evaluate("soter.page.moment")
    return found


def looks_wrong(page: Any) -> list[Any]:
    """What lies over each other on a page, and what is too pale to be read."""
    found: list[Any] = page.evaluate(
        f"(() => {{ const looks = {LOOKS}; return [...looks.overlaps(), ...looks.pale()]; }})()"
    )
    return found
