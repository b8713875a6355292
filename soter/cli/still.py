"""`soter report --still`: a moment of a recording in three dimensions."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING, Final

from soter.errors import option_error
from soter.report.colours import ac_colour, driver_colour
from soter.report.still import FINER, SIZE_PX, still_png
from soter_sim.still import Colour, Standing, photograph

if TYPE_CHECKING:
    from soter.record.content import Series
    from soter.record.reader import Recording

TRAIL_S: Final = 30.0
_EVERY_TICKS: Final = 4


def draw_still(recording: Recording, at_s: float | None) -> bytes:
    """Return the world at a moment of fleet time, or at the end, as the content of a PNG file.

    Raises:
        ConfigError: the recording does not have that moment.
        BackendError: PyBullet has no room for another world in this process.
    """
    content = recording.content(_EVERY_TICKS)
    first_s, last_s = content.first_s, content.last_s
    if at_s is not None and not first_s <= at_s <= last_s:
        raise option_error("--at", f"{at_s:g} is not in the recording; allowed: {first_s:g} to {last_s:g}")
    robots = []
    for index, about in enumerate(recording.about.robots):
        series = content.series[about.robot_id]
        if series.time_s:
            now = max(bisect_right(series.time_s, last_s if at_s is None else at_s) - 1, 0)
            driver = content.drivers[series.driver[now]]
            body = _rgb(ac_colour(index))
            band = body if series.driver[now] == 0 else _rgb(driver_colour(driver))
            place = series.x_m[now], series.y_m[now], series.heading_rad[now]
            radius_m = float(about.capabilities["body_radius_m"])
            robots.append(Standing(*place, radius_m, body, band, _trail(series, now)))
    width_px, height_px = SIZE_PX
    return still_png(photograph(recording.workspace(), robots, FINER * width_px, FINER * height_px))


def _trail(series: Series, now: int) -> list[tuple[float, float]]:
    since = bisect_right(series.time_s, series.time_s[now] - TRAIL_S)
    return [(series.x_m[at], series.y_m[at]) for at in (*range(since, now, _EVERY_TICKS), now)]


def _rgb(colour: str) -> Colour:
    return int(colour[1:3], 16) / 255.0, int(colour[3:5], 16) / 255.0, int(colour[5:7], 16) / 255.0
