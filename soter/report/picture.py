"""One picture of a run: where the robots were, who was in control when, and how the batteries fared.

The only module that knows matplotlib. It draws on a canvas of its own and leaves matplotlib's global state alone.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from soter.record.tracks import RunTracks, Track
from soter.report.caption import Broken, Caption
from soter.report.colours import MODULES, ROBOTS, ac_colour, driver_colour
from soter.report.ground import BOX, CHARGER, INK, OUTSIDE, SOFT, STRIP, draw_ground
from soter.report.strokes import end_s, marks, shares, stretches, time_unit, until, ways_since_s

WIDTH_PX: Final = 1600
HEIGHT_PX: Final = 1200
MOST_ROWS: Final = 10
"""Robots beyond this number have no time line."""

EDGE_M: Final = 0.3
"""A robot whose centre is no further from an edge is at it."""

TRAIL_S: Final = 60.0
"""What is drawn of the ways before a moment that is not the end."""

_DPI: Final = 125
_LEFT_PX: Final = 62.0
_TOP_PX: Final = 100.0
_RIGHT_PX: Final = 1552.0
_LINES_PX: Final = 124.0
_MOST_PLAN_PX: Final = 1000.0
_COLUMN_PX: Final = 108.0
_KEY_ROW_PX: Final = 34.0
_FAINT = "#D9DCE1"
_ALARM = "#B3261E"


def draw(tracks: RunTracks, caption: Caption | None, path: Path | str) -> None:
    """Draw a run into a PNG file.

    Args:
        tracks: the run.
        caption: the words above and beside it, or None for a picture without.
        path: the file; it is replaced.
    """
    Path(path).write_bytes(draw_png(tracks, caption))


def draw_png(tracks: RunTracks, caption: Caption | None = None, until_s: float | None = None) -> bytes:
    """Return the picture of a run, or of a moment of it as `make_figure` has it, as the content of a PNG file."""
    buffer = io.BytesIO()
    with mpl.rc_context({"font.family": ["DejaVu Sans"], "font.size": 9.0, "axes.linewidth": 0.8}):
        figure = make_figure(tracks, caption or Caption(), until_s)
        FigureCanvasAgg(figure)
        figure.savefig(buffer, format="png", metadata={"Software": "SOTER"})
    return buffer.getvalue()


def make_figure(run: RunTracks, caption: Caption, until_s: float | None = None) -> Figure:
    """Return the picture of a run as a figure.

    Args:
        run: the run.
        caption: the words above and beside it.
        until_s: the moment at which it is looked at: what came later is not drawn, but has its place; None for the end.
    """
    shown = run if until_s is None else until(run, until_s)
    since_s = ways_since_s(run) if until_s is None else until_s - TRAIL_S
    figure = Figure(figsize=(WIDTH_PX / _DPI, HEIGHT_PX / _DPI), dpi=_DPI, facecolor="white")
    rows = sorted(run.tracks)[:MOST_ROWS]
    row_px = min(112.0, max(34.0, 345.0 / max(len(rows), 1)))
    lines_px = row_px * len(rows)
    _head(figure, caption)
    height_px = HEIGHT_PX - lines_px - _TOP_PX - 92.0
    extent = _extent(run)
    # The plan is as large as fits, and the key begins where it ends.
    scale = min(height_px / (extent[3] - extent[1]), _MOST_PLAN_PX / (extent[2] - extent[0]))
    width_px = scale * (extent[2] - extent[0])
    plan = _axes(figure, _LEFT_PX, _TOP_PX, width_px, scale * (extent[3] - extent[1]))
    _plan(plan, shown, extent, since_s, ends=until_s is None)
    for each in caption.broken:
        _broken(plan, run, each)
    key_px = _LEFT_PX + width_px + 80.0
    _key(_axes(figure, key_px, _TOP_PX, _RIGHT_PX - key_px, height_px), shown, caption, _RIGHT_PX - key_px)
    for index, robot_id in enumerate(rows):
        top_px = HEIGHT_PX - 44.0 - lines_px + index * row_px
        axes = _axes(figure, _LINES_PX, top_px, _RIGHT_PX - _LINES_PX, row_px - min(18.0, 0.25 * row_px))
        _time_line(axes, shown, robot_id, caption, end_s(run) or 1.0, last=index == len(rows) - 1)
    if len(run.tracks) > len(rows):
        _note(figure, _LEFT_PX, HEIGHT_PX - 14.0, f"and {len(run.tracks) - len(rows)} more robots")
    return figure


def robot_colour(run: RunTracks, robot_id: int) -> str:
    """Return the colour of a robot in AC."""
    return ac_colour(sorted(run.tracks).index(robot_id))


# --- the page ----------------------------------------------------------------------------------------------


def _axes(figure: Figure, left_px: float, top_px: float, width_px: float, height_px: float) -> Axes:
    return figure.add_axes((
        left_px / WIDTH_PX, 1.0 - (top_px + height_px) / HEIGHT_PX, width_px / WIDTH_PX, height_px / HEIGHT_PX,
    ))  # fmt: skip


def _note(figure: Figure, x_px: float, y_px: float, text: str, **style: Any) -> None:
    figure.text(x_px / WIDTH_PX, 1.0 - y_px / HEIGHT_PX, text, **{"color": SOFT, "va": "baseline", **style})


def _head(figure: Figure, caption: Caption) -> None:
    colour = _ALARM if caption.alarming else INK
    _note(figure, _LEFT_PX, 46.0, caption.title, fontsize=16, weight="bold", color=INK)
    _note(figure, _LEFT_PX, 76.0, "   ·   ".join(caption.figures), fontsize=11.5, color=colour)
    _note(figure, _RIGHT_PX, 76.0, caption.details, ha="right")


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


# --- seen from above ---------------------------------------------------------------------------------------


def _plan(axes: Axes, run: RunTracks, extent: tuple[float, float, float, float], since_s: float, *, ends: bool) -> None:
    workspace = run.workspace
    axes.set_xlim(extent[0], extent[2])
    axes.set_ylim(extent[1], extent[3])
    axes.set_facecolor(OUTSIDE)
    axes.tick_params(length=3, colors=SOFT, labelsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)
    draw_ground(axes, run.workspace, run.safer_inset_m)
    _ways(axes, run, since_s)
    _marks(axes, run, since_s)
    for robot_id, track in sorted(run.tracks.items()):
        if track.time_s:
            _numbered(axes, track.x_m[0], track.y_m[0], robot_id, robot_colour(run, robot_id), filled=True)
            _numbered(axes, track.x_m[-1], track.y_m[-1], robot_id, robot_colour(run, robot_id), filled=False)
    low_x, low_y, high_x, high_y = workspace.bounds
    step = 1.0 if high_x - low_x <= 12.0 else 2.0 * math.ceil((high_x - low_x) / 24.0)
    for axis, low_m, high_m in ((axes.xaxis, low_x, high_x), (axes.yaxis, low_y, high_y)):
        axis.set_ticks([step * index for index in range(math.ceil(low_m / step), int(high_m // step) + 1)])
    axes.text(1.0, -0.012, "m", transform=axes.transAxes, color=SOFT, fontsize=8, ha="left", va="top")
    shown_s = end_s(run) - since_s
    if since_s > 0.0 and ends:
        axes.text(
            0.5, 0.004, f"ways of the last {shown_s / 60.0:.2g} min", transform=axes.transAxes, ha="center",
            va="bottom", color=SOFT, fontsize=8.5, style="italic", zorder=9,
        )  # fmt: skip


def _extent(run: RunTracks) -> tuple[float, float, float, float]:
    """Return what the plan shows in metres: the fence with a rim, and wherever a robot went beyond."""
    workspace = run.workspace
    low_x, low_y, high_x, high_y = workspace.bounds
    rim_m = 0.05 * max(high_x - low_x, high_y - low_y)
    xs_m = [x for track in run.tracks.values() for x in track.x_m]
    ys_m = [y for track in run.tracks.values() for y in track.y_m]
    return (
        min([low_x, *xs_m]) - rim_m, min([low_y, *ys_m]) - rim_m,
        max([high_x, *xs_m]) + rim_m, max([high_y, *ys_m]) + rim_m,
    )  # fmt: skip


def _ways(axes: Axes, run: RunTracks, since_s: float) -> None:
    # The more there is, the finer it is drawn.
    crowd = sum(len(stretches(track, since_s)) for track in run.tracks.values()) / 100.0
    fine = 1.0 if crowd < 3.0 else 0.8
    for robot_id, track in sorted(run.tracks.items()):
        by_driver: dict[int, list[list[tuple[float, float]]]] = {}
        for driver, first, last in stretches(track, since_s):
            points = list(zip(track.x_m[first : last + 1], track.y_m[first : last + 1], strict=True))
            by_driver.setdefault(driver, []).append(points)
        for driver, ways in by_driver.items():
            ac = driver == 0
            colour = robot_colour(run, robot_id) if ac else driver_colour(run.drivers[driver])
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


def _broken(axes: Axes, run: RunTracks, broken: Broken) -> None:
    """Show where something was broken: a ring around the robot, and the edge of fence or box that it is at."""
    edge = _edge_at(run, broken.x_m, broken.y_m)
    if edge is not None:
        axes.plot(*edge, color=_ALARM, lw=4.5, solid_capstyle="butt", zorder=9)
    axes.plot([broken.x_m], [broken.y_m], "o", ms=22, mfc="none", mec=_ALARM, mew=2.2, zorder=10)
    side = -1.0 if broken.x_m > run.workspace.width_m / 2.0 else 1.0
    up = 1.0 if broken.y_m < run.workspace.depth_m / 2.0 else -1.0
    axes.annotate(
        broken.text, (broken.x_m, broken.y_m), (side * 22.0, up * 18.0),
        textcoords="offset points", color=_ALARM, fontsize=9, weight="bold", zorder=11, va="center",
        ha="right" if side < 0.0 else "left",
        bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": _ALARM, "lw": 0.8},
    )  # fmt: skip


def _edge_at(run: RunTracks, x_m: float, y_m: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the edge of the fence, or of a box, that a place is at, as its ends' x and y; None if it is at none."""
    room = run.workspace
    edges = []
    for west, south, east, north in (
        (0.0, 0.0, room.width_m, room.depth_m),
        *((box.low_x_m, box.low_y_m, box.high_x_m, box.high_y_m) for box in room.boxes),
    ):
        edges += [((west, east), (south, south)), ((west, east), (north, north))]
        edges += [((west, west), (south, north)), ((east, east), (south, north))]

    def away_m(edge: tuple[tuple[float, float], tuple[float, float]]) -> float:
        (x1, x2), (y1, y2) = edge
        return math.hypot(x_m - min(max(x_m, x1), x2), y_m - min(max(y_m, y1), y2))

    nearest = min(edges, key=away_m)
    return nearest if away_m(nearest) <= EDGE_M else None


def _numbered(axes: Axes, x_m: float, y_m: float, robot_id: int, colour: str, *, filled: bool) -> None:
    axes.plot([x_m], [y_m], "o", ms=13, mfc=colour if filled else "white", mec="white" if filled else colour,
              mew=1.2, zorder=7)  # fmt: skip
    axes.text(x_m, y_m, str(robot_id), color="white" if filled else colour, fontsize=7.5, weight="bold", ha="center",
              va="center_baseline", zorder=8)  # fmt: skip


# --- the key -----------------------------------------------------------------------------------------------


def _key(axes: Axes, run: RunTracks, caption: Caption, width_px: float) -> None:
    """Draw the key: who was in control, how the rules fared, what the marks mean. In pixels, y down."""
    _bare(axes)
    height_px = axes.get_position().height * HEIGHT_PX
    axes.set_xlim(0.0, width_px)
    axes.set_ylim(height_px, 0.0)
    samples = _mark_samples(run, caption)
    rows = len(run.drivers) + len(samples) + (len(caption.rules) + 2 if caption.rules else 0) + 3
    row_px = min(_KEY_ROW_PX, (height_px - 16.0) / rows)
    counted = bool(caption.disengagements)
    columns = (width_px - _COLUMN_PX, width_px) if counted else (width_px,)
    top = 16.0
    _heading(axes, top, "In control", width_px, dict(zip(columns, ("of the time", "took over"), strict=False)))
    for driver, share in enumerate(shares(run)):
        top += row_px
        _driver_row(axes, top, run, driver, share, columns[0] - _COLUMN_PX)
        _cell(axes, columns[0], top, "< 1 %" if 0.0 < share < 0.005 else f"{100.0 * share:.0f} %")
        if run.drivers[driver] in caption.disengagements:
            _cell(axes, width_px, top, f"{caption.disengagements[run.drivers[driver]]} ×")
    if caption.rules:
        top += 1.6 * row_px
        columns = (width_px - _COLUMN_PX, width_px)
        _heading(axes, top, "Ground truth", width_px, dict(zip(columns, ("violated", "least margin"), strict=True)))
        for rule in caption.rules:
            top += row_px
            axes.text(50.0, top, rule.name, color=INK, fontsize=9.5, va="center")
            for right, text in zip(columns, (rule.violations, rule.margin), strict=True):
                _cell(axes, right, top, text, _ALARM if rule.broken else INK)
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
    name = run.drivers[driver]
    colours = [robot_colour(run, robot_id) for robot_id in sorted(run.tracks)][: len(ROBOTS)] if driver == 0 else []
    colours = colours or [driver_colour(name)]
    for index, colour in enumerate(colours):
        # The robots' lines are fine and stand one above the other; a module's is one bold line.
        at = y + (index - 0.5 * (len(colours) - 1)) * min(6.0, 24.0 / len(colours))
        axes.add_line(Line2D([2.0, 34.0], [at, at], color=colour, solid_capstyle="round",
                             lw=1.3 if driver == 0 else 2.6))  # fmt: skip
    axes.text(50.0, y, "AC, by robot" if driver == 0 else name, color=INK, fontsize=9.5, va="center")
    start = 174.0
    axes.add_patch(Rectangle((start, y - 7.0), bar_end - start, 14.0, fc="#F0F1F4", ec="none"))
    axes.add_patch(Rectangle((start, y - 7.0), (bar_end - start) * share, 14.0, fc=colours[0], ec="none"))


def _mark_samples(run: RunTracks, caption: Caption) -> list[tuple[str, Any]]:
    """Return the meaning of every mark, and what draws a sample of it at a height."""
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
    samples.append(("box", lambda y: [patch(y, fc=BOX, ec="none")]))
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


# --- over time ---------------------------------------------------------------------------------------------


def _time_line(axes: Axes, run: RunTracks, robot_id: int, caption: Caption, end: float, *, last: bool) -> None:
    """Draw one robot's time: who was in control as a band on top, the charge as a curve below."""
    track, colour = run.tracks[robot_id], robot_colour(run, robot_id)
    unit_s, unit = time_unit(end)
    axes.set_xlim(0.0, end / unit_s)
    axes.set_ylim(0.0, 1.52)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set_color(_FAINT)
    _band(axes, run, track, colour, unit_s)
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


def _band(axes: Axes, run: RunTracks, track: Track, colour: str, unit_s: float) -> None:
    bars: dict[int, list[tuple[float, float]]] = {}
    for driver, first, last in stretches(track):
        start = track.time_s[first] / unit_s
        bars.setdefault(driver, []).append((start, track.time_s[last] / unit_s - start))
    for driver, spans in bars.items():
        axes.broken_barh(
            spans, (1.14, 0.38), fc=colour if driver == 0 else driver_colour(run.drivers[driver]),
            alpha=0.28 if driver == 0 else 1.0, ec="none", zorder=2 if driver == 0 else 3,
        )  # fmt: skip


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
