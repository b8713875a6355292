"""Draws a run from above: the robots' ways, and the places of changes of control and of broken rules."""

from __future__ import annotations

import math
from typing import Final

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from soter.record.tracks import RunTracks
from soter.report.caption import Margins, Remark
from soter.report.colours import ac_colour, driver_colour
from soter.report.ground import INK, OUTSIDE, SOFT, draw_ground
from soter.report.strokes import STARTING, broken_at, end_s, marks, stretches

ALARM: Final = "#B3261E"

_MARK_PT: Final = 13.0
"""Size of the marks of starts and ends, in points."""

BROKEN_PT: Final = 9.0
"""Size of the rings where a robot began to break a rule, in points."""

Extent = tuple[float, float, float, float]
"""Low x and y, high x and y, in metres."""


def robot_colour(run: RunTracks, robot_id: int) -> str:
    """Return the colour of a robot in AC."""
    return ac_colour(sorted(run.tracks).index(robot_id))


def name_of(run: RunTracks, driver: int) -> str:
    """Return the name of a driver, see `Stretch`."""
    return "starting" if driver == STARTING else run.drivers[driver]


def colour_of(run: RunTracks, robot_id: int, driver: int) -> str:
    """Return the colour of a robot while a driver has it, see `Stretch`."""
    if driver == STARTING:
        return SOFT
    return robot_colour(run, robot_id) if driver == 0 else driver_colour(run.drivers[driver])


def extent_of(run: RunTracks) -> Extent:
    """Return the extent of the plan in metres: the fence with a rim, and all places of robots beyond it."""
    low_x, low_y, high_x, high_y = run.workspace.bounds
    rim_m = 0.05 * max(high_x - low_x, high_y - low_y)
    xs_m = [x for track in run.tracks.values() for x in track.x_m]
    ys_m = [y for track in run.tracks.values() for y in track.y_m]
    return (
        min([low_x, *xs_m]) - rim_m, min([low_y, *ys_m]) - rim_m,
        max([high_x, *xs_m]) + rim_m, max([high_y, *ys_m]) + rim_m,
    )  # fmt: skip


def draw_place(axes: Axes, run: RunTracks, extent: Extent) -> None:
    """Draw the ground, which does not move, in metres."""
    axes.set_xlim(extent[0], extent[2])
    axes.set_ylim(extent[1], extent[3])
    axes.set_facecolor(OUTSIDE)
    axes.tick_params(length=3, colors=SOFT, labelsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)
    draw_ground(axes, run.workspace, run.safer_inset_m)
    low_x, low_y, high_x, high_y = run.workspace.bounds
    step = 1.0 if high_x - low_x <= 12.0 else 2.0 * math.ceil((high_x - low_x) / 24.0)
    for axis, low_m, high_m in ((axes.xaxis, low_x, high_x), (axes.yaxis, low_y, high_y)):
        axis.set_ticks([step * index for index in range(math.ceil(low_m / step), int(high_m // step) + 1)])
    axes.text(1.0, -0.012, "m", transform=axes.transAxes, color=SOFT, fontsize=8, ha="left", va="top")


def draw_ways(axes: Axes, run: RunTracks, since_s: float, note: str = "") -> list[Artist]:
    """Draw the robots' ways from a time on, with a note at the foot of the plan; return the artists."""
    before = set(axes.get_children())
    _ways(axes, run, since_s)
    _marks(axes, run, since_s)
    for robot_id, track in sorted(run.tracks.items()):
        if track.time_s:
            start, end = (track.x_m[0], track.y_m[0]), (track.x_m[-1], track.y_m[-1])
            colour = robot_colour(run, robot_id)
            if _apart_pt(axes, start, end) > _MARK_PT:
                _disc(axes, *end, colour, "white", _MARK_PT)
                _number(axes, *end, robot_id, colour)
            else:
                # An end at the start would hide it: draw a ring around it.
                _disc(axes, *start, colour, "white", 1.5 * _MARK_PT)
            _disc(axes, *start, "white", colour, _MARK_PT)
            _number(axes, *start, robot_id, "white")
    # All of them, also those before the ways that are drawn: there ought to be none.
    x_m, y_m = [x for x, _ in broken_at(run)], [y for _, y in broken_at(run)]
    axes.scatter(x_m, y_m, s=BROKEN_PT**2, fc="none", ec=ALARM, lw=1.4, zorder=7.5)
    if note:
        _note(axes, note, SOFT)
    return sorted((each for each in axes.get_children() if each not in before), key=Artist.get_zorder)


def since_note(run: RunTracks, since_s: float) -> str:
    """Return in words which part of a run's ways is drawn; empty if all of them are."""
    return f"ways of the last {(end_s(run) - since_s) / 60.0:.2g} min" if since_s > 0.0 else ""


def _ways(axes: Axes, run: RunTracks, since_s: float) -> None:
    # The more stretches there are, the thinner the lines.
    crowd = sum(len(stretches(track, since_s)) for track in run.tracks.values()) / 100.0
    fine = 1.0 if crowd < 3.0 else 0.8
    for robot_id, track in sorted(run.tracks.items()):
        by_driver: dict[int, list[list[tuple[float, float]]]] = {}
        for driver, first, last in stretches(track, since_s, run.started_s(robot_id)):
            points = list(zip(track.x_m[first : last + 1], track.y_m[first : last + 1], strict=True))
            by_driver.setdefault(driver, []).append(points)
        for driver, ways in by_driver.items():
            ac = driver == 0
            colour = colour_of(run, robot_id, driver)
            axes.add_collection(LineCollection(
                ways, colors=colour, linewidths=(1.1 if ac else 2.4) * fine, alpha=0.6 if ac else 0.9,
                zorder=3 if ac else 4, capstyle="round", joinstyle="round",
            ))  # fmt: skip


def _marks(axes: Axes, run: RunTracks, since_s: float) -> None:
    found = marks(run, since_s)
    scale = 1.0 if len(found) < 150 else 0.7
    back = [mark for mark in found if mark.module is None]
    axes.scatter(
        [mark.x_m for mark in back], [mark.y_m for mark in back], s=9 * scale, fc="white",
        ec=[robot_colour(run, mark.robot_id) for mark in back], lw=0.8, zorder=5,
    )  # fmt: skip
    taken = [mark for mark in found if mark.module is not None]
    axes.scatter(
        [mark.x_m for mark in taken], [mark.y_m for mark in taken], s=26 * scale,
        c=[driver_colour(mark.module or "") for mark in taken], ec="white", lw=0.7, zorder=6,
    )  # fmt: skip


def _apart_pt(axes: Axes, one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the distance of two places on the plan, in points."""
    (x, y), (other_x, other_y) = axes.transData.transform([one, other])
    return math.hypot(x - other_x, y - other_y) * 72.0 / axes.figure.dpi


def _disc(axes: Axes, x_m: float, y_m: float, edge: str, face: str, size_pt: float) -> None:
    axes.plot([x_m], [y_m], "o", ms=size_pt, mfc=face, mec=edge, mew=1.2, zorder=7)


def _number(axes: Axes, x_m: float, y_m: float, robot_id: int, colour: str) -> None:
    axes.text(x_m, y_m, str(robot_id), color=colour, fontsize=7.5, weight="bold", ha="center", va="center_baseline",
              zorder=8)  # fmt: skip


def draw_rule(axes: Axes, rule: Margins) -> None:
    """Draw where a rule is broken, and its edge."""
    x_m, y_m, margins = rule.x_m, rule.y_m, rule.margins
    axes.contourf(x_m, y_m, margins, [-math.inf, 0.0], colors=[ALARM], alpha=0.12, zorder=1.7)
    axes.contour(x_m, y_m, margins, [0.0], colors=[ALARM], linewidths=2.2, zorder=2.5)
    _note(axes, f"red: {rule.text}", ALARM)


def _note(axes: Axes, text: str, colour: str) -> None:
    """Write a note on the whole plan at its foot."""
    axes.text(0.5, 0.004, text, transform=axes.transAxes, ha="center", va="bottom", color=colour, fontsize=8.5,
              style="italic", zorder=9)  # fmt: skip


def draw_remark(axes: Axes, remark: Remark) -> None:
    """Write a label beside a ring around a place on the plan, on the side with more room."""
    colour = ALARM if remark.broken else INK
    axes.plot(
        [remark.x_m], [remark.y_m], "o", ms=22, mfc="none", mec=colour, mew=2.2 if remark.broken else 1.2, zorder=10
    )
    east, north = axes.get_xlim(), axes.get_ylim()
    side = -1.0 if remark.x_m > sum(east) / 2.0 else 1.0
    up = 1.0 if remark.y_m < sum(north) / 2.0 else -1.0
    # Broken rules are written towards the middle, others away from it, so that two labels at one place do not overlap.
    up = up if remark.broken else -up
    axes.annotate(
        remark.text, (remark.x_m, remark.y_m), (side * 22.0, up * 18.0), textcoords="offset points", color=colour,
        fontsize=9, weight="bold", zorder=11, va="center", ha="right" if side < 0.0 else "left",
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": colour, "lw": 0.8},
    )  # fmt: skip
