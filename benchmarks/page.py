"""How large the page of a long run is, and how long it takes to open in Chromium, over a bare page of the same size.

Two hours of two robots on the kinematic engine. "Open" is when the page can be played: its data are unpacked and its
first picture is drawn. The live page is that of the same run, opened by somebody who comes when it ends.
"""

from __future__ import annotations

import base64
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from soter.config import load_mission
from soter.live.web import PageScreen
from soter.record.follow import GrowingRecording
from soter.record.reader import Recording
from soter.report.page.html import make_page
from soter.runner import run_mission
from tests.report.chromium import CHROMIUM, chromium, until

GOAL_MB: Final = 8.0
GOAL_S: Final = 3.0
BARE: Final = """<!doctype html><title>bare</title><script type="application/octet-stream">{data}</script>
<script>window.soter = {{openedMs: performance.now()}};</script>"""


def main(argv: Sequence[str] | None = None) -> bool:
    """Measure and print; return whether the goals are met."""
    quick = arguments(__doc__ or "", argv).quick
    if CHROMIUM is None:
        raise SystemExit("NOT RUN: there is no Chromium on the PATH (Debian: apt-get install chromium)")
    duration_s, rounds = (20.0, 1) if quick else (7200.0, 7)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        mission = load_mission(
            SURVEILLANCE, {"backend": "kinematic", "planner": "straight-line", "duration_s": duration_s}
        )
        run_mission(mission, record=path)
        began_s = time.perf_counter()
        text = make_page(Recording(path)).encode()
        made_s = time.perf_counter() - began_s
        page, bare = Path(folder) / "page.html", Path(folder) / "bare.html"
        page.write_bytes(text)
        noise = base64.b64encode(random.Random(1).randbytes(len(text) * 3 // 4)).decode()
        bare.write_text(BARE.format(data=noise), encoding="ascii")
        screen = PageScreen(0)
        screen.show(GrowingRecording(path, lambda: True, lambda: None))
        live = f"http://127.0.0.1:{screen.port}/"
        with chromium() as browser:
            addresses = {"bare": bare.as_uri(), "page": page.as_uri(), "live": live}
            times = in_turns({name: _opening(browser, each) for name, each in addresses.items()}, rounds)
        screen.close()
    opened_s = {name: statistics.median(each) for name, each in times.items()}
    size_mb = len(text) / 1e6
    small, soon = size_mb < GOAL_MB, max(opened_s["page"], opened_s["live"]) < GOAL_S
    rows = [Row(f"bare page of {size_mb:.2f} MB", f"{opened_s['bare']:.2f} s")]
    for name in ("page", "live"):
        ratio = opened_s[name] / opened_s["bare"]
        rows.append(Row(f"{name} open", f"{opened_s[name]:.2f} s", ratio, f"< {GOAL_S:g} s", opened_s[name] < GOAL_S))
    rows.append(Row("size of the page", f"{size_mb:.2f} MB", size_mb / GOAL_MB, f"< {GOAL_MB:g} MB", small))
    remark = f"{duration_s / 3600.0:.2g} h of two robots; medians of {rounds} rounds; made in {made_s:.1f} s."
    show("The page of a run", rows, remark)
    return small and soon


def _opening(browser: Any, address: str) -> Callable[[], float]:
    """Return what opens a page in a window of its own and says how long that took, in seconds."""

    def measure() -> float:
        context = browser.new_context(viewport={"width": 1440, "height": 900})
        page = context.new_page()
        page.goto(address)
        until(page, "window.soter && window.soter.openedMs")
        opened_ms = float(page.evaluate("soter.openedMs"))
        context.close()
        return opened_ms / 1000.0

    return measure


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
