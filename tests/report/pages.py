"""Pages of recordings that are opened in a browser, and what is looked at on them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from soter.record.content import Content
from soter.record.reader import Recording
from soter.report.page.html import make_page
from tests.record.helpers import recorded

DURATION_S = 240.0


PHONE = {"width": 390, "height": 844}
NARROW_PHONE = {"width": 360, "height": 740}


SIZES = {390: 844, 820: 1180, 1280: 720, 1920: 1080}
"""Heights of windows by their widths: a phone, a tablet, a laptop, a wide screen."""


class Made(NamedTuple):
    """A page, and what it is of."""

    path: Path
    content: Content


def pixel(page: Any, x_m: float, y_m: float) -> tuple[int, int, int]:
    """The colour of a place on the plan."""
    red, green, blue = page.evaluate(
        """([x, y]) => {
            const plan = soter.page.plan;
            const [right, down] = plan.at(x, y).map((each) => Math.round(each * plan.ratio));
            const probe = new OffscreenCanvas(1, 1).getContext("2d", {willReadFrequently: true});
            probe.drawImage(plan.canvas, right, down, 1, 1, 0, 0, 1, 1);
            return [...probe.getImageData(0, 0, 1, 1).data.slice(0, 3)];
        }""",
        [x_m, y_m],
    )
    return red, green, blue


def rgb(colour: str) -> tuple[int, int, int]:
    """A colour of the page's own, in numbers."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def distance(one: tuple[int, int, int], other: tuple[int, int, int]) -> float:
    return math.dist(one, other)


def page_of(folder: Path, **overrides: Any) -> Made:
    """The page of a run that is recorded into a folder; double underscores in names stand for dots."""
    recorded(folder / "run.mcap", **overrides)
    recording = Recording(folder / "run.mcap")
    (folder / "run.html").write_text(make_page(recording), encoding="utf-8")
    return Made(folder / "run.html", recording.content())
