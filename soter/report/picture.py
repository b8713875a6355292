"""Draws one picture of a run: the robots' ways, the active controllers over time, and the charges.

The picture has a canvas of its own and does not touch matplotlib's global state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from soter.record.tracks import RunTracks, Track
from soter.report.caption import Caption
from soter.report.colours import MODULES, ROBOTS, driver_colour
from soter.report.ground import BOX, CHARGER, INK, SOFT, STRIP, png_of, styled
from soter.report.plan import (
    ALARM,
    BROKEN_PT,
    colour_of,
    draw_place,
    draw_remark,
    draw_rule,
    draw_ways,
    extent_of,
    name_of,
    robot_colour,
    since_note,
)
from soter.report.strokes import end_s, shares, stretches, time_unit, ways_since_s

WIDTH_PX: Final = 1600
HEIGHT_PX: Final = 1200
MOST_ROWS: Final = 10
"""Most robots with a time line."""

_DPI: Final = 125
_LEFT_PX: Final = 62.0
_TOP_PX: Final = 100.0
_RIGHT_PX: Final = 1552.0
_LINES_PX: Final = 124.0
_MOST_PLAN_PX: Final = 880.0
_COLUMN_PX: Final = 108.0
_KEY_ROW_PX: Final = 34.0
_LEAST_PX: Final = 3.0
_FAINT = "#D9DCE1"


def draw_png(tracks: RunTracks, caption: Caption | None = None) -> bytes:
    """Return the picture of a run as the content of a PNG file."""
    with styled():
        return png_of(make_figure(tracks, caption or Caption()))


def make_figure(run: RunTracks, caption: Caption, *, ways: bool = True) -> Figure:
    """Return the picture of a run as a figure: its axes are the plan, the key, and one for each robot's time."""
    figure = Figure(figsize=(WIDTH_PX / _DPI, HEIGHT_PX / _DPI), dpi=_DPI, facecolor="white")
    rows = sorted(run.tracks)[:MOST_ROWS]
    row_px = min(112.0, max(34.0, 345.0 / max(len(rows), 1)))
    lines_px = row_px * len(rows)
    _head(figure, caption)
    height_px = HEIGHT_PX - lines_px - _TOP_PX - 92.0
    extent = extent_of(run)
    # The plan is as large as fits, and the key begins where the plan ends.
    scale = min(height_px / (extent[3] - extent[1]), _MOST_PLAN_PX / (extent[2] - extent[0]))
    width_px = scale * (extent[2] - extent[0])
    plan = _axes(figure, _LEFT_PX, _TOP_PX, width_px, scale * (extent[3] - extent[1]))
    draw_place(plan, run, extent)
    if caption.rule is not None:
        draw_rule(plan, caption.rule)
    if ways:
        since_s = ways_since_s(run)
        draw_ways(plan, run, since_s, since_note(run, since_s))
    for each in caption.remarks:
        draw_remark(plan, each)
    key_px = _LEFT_PX + width_px + 80.0
    _key(_axes(figure, key_px, _TOP_PX, _RIGHT_PX - key_px, height_px), run, caption, _RIGHT_PX - key_px)
    for index, robot_id in enumerate(rows):
        top_px = HEIGHT_PX - 44.0 - lines_px + index * row_px
        axes = _axes(figure, _LINES_PX, top_px, _RIGHT_PX - _LINES_PX, row_px - min(18.0, 0.25 * row_px))
        _time_line(axes, run, robot_id, caption, end_s(run) or 1.0, last=index == len(rows) - 1)
    if len(run.tracks) > len(rows):
        _note(figure, _LEFT_PX, HEIGHT_PX - 14.0, f"and {len(run.tracks) - len(rows)} more robots")
    return figure


def _axes(figure: Figure, left_px: float, top_px: float, width_px: float, height_px: float) -> Axes:
    return figure.add_axes((
        left_px / WIDTH_PX, 1.0 - (top_px + height_px) / HEIGHT_PX, width_px / WIDTH_PX, height_px / HEIGHT_PX,
    ))  # fmt: skip


def _note(figure: Figure, x_px: float, y_px: float, text: str, **style: Any) -> None:
    figure.text(x_px / WIDTH_PX, 1.0 - y_px / HEIGHT_PX, text, **{"color": SOFT, "va": "baseline", **style})


def _head(figure: Figure, caption: Caption) -> None:
    colour = ALARM if caption.alarming else INK
    _note(figure, _LEFT_PX, 46.0, caption.title, fontsize=16, weight="bold", color=INK)
    _note(figure, _LEFT_PX, 76.0, "   ·   ".join(caption.figures), fontsize=11.5, color=colour)
    _note(figure, _RIGHT_PX, 76.0, caption.details, ha="right")


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _key(axes: Axes, run: RunTracks, caption: Caption, width_px: float) -> None:
    """Draw the key: shares of control, the rules' results, the meaning of marks. In pixels, y down."""
    _bare(axes)
    height_px = axes.get_position().height * HEIGHT_PX
    axes.set_xlim(0.0, width_px)
    axes.set_ylim(height_px, 0.0)
    samples = _mark_samples(run, caption)
    parts = shares(run)
    rows = len(parts) + len(samples) + (len(caption.rules) + 2 if caption.rules else 0) + 3
    row_px = min(_KEY_ROW_PX, (height_px - 16.0) / rows)
    counted = bool(caption.disengagements)
    columns = (width_px - _COLUMN_PX, width_px) if counted else (width_px,)
    top = 16.0
    _heading(axes, top, "In control", width_px, dict(zip(columns, ("of the time", "took over"), strict=False)))
    for driver, share in parts.items():
        name = name_of(run, driver)
        top += row_px
        _driver_row(axes, top, run, driver, share, columns[0] - _COLUMN_PX)
        _cell(axes, columns[0], top, "< 1 %" if 0.0 < share < 0.005 else f"{100.0 * share:.0f} %")
        if name in caption.disengagements:
            _cell(axes, width_px, top, f"{caption.disengagements[name]} ×")
    if caption.rules:
        top += 1.6 * row_px
        columns = (width_px - _COLUMN_PX, width_px)
        _heading(axes, top, "Ground truth", width_px, dict(zip(columns, ("violated", "least margin"), strict=True)))
        for rule in caption.rules:
            top += row_px
            axes.text(50.0, top, rule.name, color=INK, fontsize=9.5, va="center")
            for right, text in zip(columns, (rule.violations, rule.margin), strict=True):
                _cell(axes, right, top, text, ALARM if rule.broken else INK)
    top += 1.6 * row_px
    _heading(axes, top, "Marks", width_px, {})
    for text, artists in samples:
        top += row_px
        for artist in artists(top):
            axes.add_artist(artist)
        axes.text(50.0, top, text, color=INK, fontsize=9.5, va="center")


def _cell(axes: Axes, right: float, y: float, text: str, colour: str = INK) -> None:
    axes.text(right, y, text, color=colour, fontsize=9.5, ha="right", va="center")


def _heading(axes: Axes, y: float, text: str, width_px: float, columns: dict[float, str]) -> None:
    axes.text(0.0, y, text, color=INK, fontsize=10, weight="bold", va="center")
    for right, title in columns.items():
        axes.text(right, y, title, color=SOFT, fontsize=8, ha="right", va="center")
    axes.add_line(Line2D([0.0, width_px], [y + 14.0, y + 14.0], color=_FAINT, lw=0.8))


def _driver_row(axes: Axes, y: float, run: RunTracks, driver: int, share: float, bar_end: float) -> None:
    robots = sorted(run.tracks)[: len(ROBOTS) if driver == 0 else 1]
    colours = [colour_of(run, robot_id, driver) for robot_id in robots] or [SOFT]
    for index, colour in enumerate(colours):
        # The robots' lines are thin and one above the other; a module's is one bold line.
        at = y + (index - 0.5 * (len(colours) - 1)) * min(6.0, 24.0 / len(colours))
        axes.add_line(Line2D([2.0, 34.0], [at, at], color=colour, solid_capstyle="round",
                             lw=1.3 if driver == 0 else 2.6))  # fmt: skip
    axes.text(50.0, y, "AC, by robot" if driver == 0 else name_of(run, driver), color=INK, fontsize=9.5, va="center")
    start = 174.0
    axes.add_patch(Rectangle((start, y - 7.0), bar_end - start, 14.0, fc="#F0F1F4", ec="none"))
    axes.add_patch(Rectangle((start, y - 7.0), (bar_end - start) * share, 14.0, fc=colours[0], ec="none"))


def _mark_samples(run: RunTracks, caption: Caption) -> list[tuple[str, Any]]:
    """Return the meaning of every mark, and the function that draws a sample of it at a height."""
    robot, modules = ROBOTS[0], [driver_colour(name) for name in run.drivers[1:4]]

    def disc(x: float, y: float, size: float, **style: Any) -> Line2D:
        return Line2D([x], [y], marker="o", ms=size, ls="", **style)

    def patch(y: float, **style: Any) -> Rectangle:
        return Rectangle((2.0, y - 10.0), 32.0, 20.0, **style)

    samples: list[tuple[str, Any]] = [
        ("start and end of a robot", lambda y: [
            disc(8.0, y, 9, mfc=robot, mec="white"), disc(28.0, y, 9, mfc="white", mec=robot, mew=1.2),
        ]),
    ]  # fmt: skip
    if len(run.drivers) > 1:
        samples += [
            ("a safety module took over", lambda y: [
                disc(6.0 + 12.0 * index, y, 6.0, mfc=colour, mec="white", mew=0.7)
                for index, colour in enumerate(modules)
            ]),
            ("given back to the AC", lambda y: [disc(18.0, y, 4, mfc="white", mec=robot, mew=0.9)]),
        ]  # fmt: skip
    if run.violations:
        samples.append(("began to break a rule", lambda y: [
            disc(8.0, y, BROKEN_PT, mfc="none", mec=ALARM, mew=1.4),
            Rectangle((20.0, y - 3.0), 14.0, 6.0, fc=ALARM, ec="none"),
        ]))  # fmt: skip
    samples.append(("kept out", lambda y: [patch(y, fc=BOX, ec="none")]))
    samples.append(("charger", lambda y: [patch(y, fc=CHARGER, ec=MODULES["battery"], lw=1.0)]))
    if run.safer_inset_m is not None:
        samples.append(("from the fence to phi_safer of the geofence", lambda y: [
            patch(y, fc=STRIP, ec="none"),
            Line2D([2.0, 34.0], [y - 10.0, y - 10.0], color=INK, lw=1.8),
            Line2D([2.0, 34.0], [y + 10.0, y + 10.0], color=SOFT, lw=0.8, ls=(0, (4, 3))),
        ]))  # fmt: skip
    else:
        samples.append(("fence", lambda y: [Line2D([2.0, 30.0], [y, y], color=INK, lw=1.8)]))
    if caption.safer_charge is not None:
        charge = f"charge over time; given back from {100.0 * caption.safer_charge:.0f} % on"
        samples.append((charge, lambda y: [
            patch(y, fc=MODULES["battery"], ec="none", alpha=0.1),
            Line2D([2.0, 34.0], [y + 3.0, y - 4.0], color=MODULES["battery"], lw=1.3),
            Line2D([2.0, 34.0], [y - 7.0, y - 7.0], color=SOFT, lw=0.8, ls=(0, (4, 3))),
        ]))  # fmt: skip
    return samples


def _time_line(axes: Axes, run: RunTracks, robot_id: int, caption: Caption, end: float, *, last: bool) -> None:
    """Draw one robot's time line: violations on top, the driver as a band, the charge as a curve below."""
    track, colour = run.tracks[robot_id], robot_colour(run, robot_id)
    unit_s, unit = time_unit(end)
    axes.set_xlim(0.0, end / unit_s)
    axes.set_ylim(0.0, 1.8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(_FAINT)
    _band(axes, run, robot_id, unit_s)
    _violations(axes, run, robot_id, end, unit_s)
    _charge(axes, track, caption, unit_s)
    axes.set_yticks([0.0, 1.0], ["0", "100 %"])
    axes.tick_params(axis="y", length=0, labelsize=7, labelcolor=SOFT)
    axes.tick_params(axis="x", length=3 if last else 0, labelsize=8, labelbottom=last, colors=SOFT)
    axes.annotate(
        str(robot_id), (0.0, 0.5), (-78.0, 0.0), xycoords="axes fraction", textcoords="offset pixels",
        color="white", fontsize=8, weight="bold", ha="center", va="center_baseline",
        bbox={"boxstyle": "circle,pad=0.35", "fc": colour, "ec": "none"},
    )  # fmt: skip
    if last:
        axes.text(1.004, 0.0, unit, transform=axes.transAxes, color=SOFT, fontsize=8, ha="left", va="center")


def _band(axes: Axes, run: RunTracks, robot_id: int, unit_s: float) -> None:
    track = run.tracks[robot_id]
    bars: dict[int, list[tuple[float, float]]] = {}
    for driver, first, last in stretches(track, started_s=run.started_s(robot_id)):
        start = track.time_s[first] / unit_s
        bars.setdefault(driver, []).append((start, track.time_s[last] / unit_s - start))
    for driver, spans in bars.items():
        axes.broken_barh(
            spans, (1.14, 0.38), fc=colour_of(run, robot_id, driver),
            alpha=0.28 if driver == 0 else 1.0, ec="none", zorder=2 if driver == 0 else 3,
        )  # fmt: skip


def _violations(axes: Axes, run: RunTracks, robot_id: int, end: float, unit_s: float) -> None:
    # The shortest one can be seen too, also at the end.
    least_s = end * _LEAST_PX / (_RIGHT_PX - _LINES_PX)
    spans = [
        (each.start_s / unit_s, max((end if each.end_s is None else each.end_s) - each.start_s, least_s) / unit_s)
        for each in run.violations
        if robot_id in each.robots
    ]
    axes.broken_barh(spans, (1.58, 0.22), fc=ALARM, ec="none", zorder=3, clip_on=False)


def _charge(axes: Axes, track: Track, caption: Caption, unit_s: float) -> None:
    times = [time / unit_s for time in track.time_s]
    if all(math.isnan(charge) for charge in track.battery):
        axes.text(0.005, 0.3, "charge unknown", transform=axes.transAxes, color=SOFT, fontsize=8)
        return
    axes.fill_between(times, _known(track.battery), 0.0, color=MODULES["battery"], alpha=0.10, lw=0)
    axes.plot(times, _known(track.battery), color=MODULES["battery"], lw=1.3)
    if caption.safer_charge is not None:
        axes.axhline(caption.safer_charge, color=SOFT, lw=0.7, ls=(0, (5, 4)))


def _known(charges: Sequence[float]) -> list[float]:
    return [min(max(charge, 0.0), 1.0) if not math.isnan(charge) else math.nan for charge in charges]
