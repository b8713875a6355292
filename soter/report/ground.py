"""A workspace seen from above: the ground of every picture, and a picture of its own."""

from __future__ import annotations

import io
from contextlib import AbstractContextManager
from typing import Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from soter.geometry.workspace import Workspace
from soter.report.colours import MODULES

INK, SOFT = "#22272E", "#6A717B"
OUTSIDE, STRIP, INSIDE, BOX, CHARGER = "#E4E6EA", "#F7F1E3", "#FFFFFF", "#4A515C", "#DDF1EA"
_SIDE_IN: Final = 8.0
_RIM: Final = 0.05


def workspace_png(workspace: Workspace) -> bytes:
    """Return a picture of a workspace, with the numbers of its robots, as the content of a PNG file."""
    low_x, low_y, high_x, high_y = workspace.bounds
    wide_m, deep_m = high_x - low_x, high_y - low_y
    rim_m, scale = _RIM * max(wide_m, deep_m), _SIDE_IN / max(wide_m, deep_m)
    with styled():
        figure = Figure(figsize=(max(3.0, scale * wide_m) + 1.0, max(3.0, scale * deep_m) + 1.0), dpi=110)
        axes = figure.add_subplot(aspect="equal")
        axes.set_facecolor(OUTSIDE)
        axes.set_xlim(low_x - rim_m, high_x + rim_m)
        axes.set_ylim(low_y - rim_m, high_y + rim_m)
        draw_ground(axes, workspace, None)
        for place in workspace.robots:
            axes.plot(place.x_m, place.y_m, "o", ms=4.0, color=INK, zorder=3.0)
            axes.annotate(str(place.id), (place.x_m, place.y_m), (5, 5), textcoords="offset points", color=INK)
        axes.set_xlabel("east, m", color=SOFT)
        axes.set_ylabel("north, m", color=SOFT)
        return png_of(figure)


def styled() -> AbstractContextManager[None]:
    """Return a context in which matplotlib has the settings of pictures."""
    return mpl.rc_context({"font.family": ["DejaVu Sans"], "font.size": 9.0, "axes.linewidth": 0.8})


def png_of(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", metadata={"Software": "SOTER"})
    return buffer.getvalue()


def draw_ground(axes: Axes, workspace: Workspace, inset_m: float | None) -> None:
    """Draw fence, stations and keep-outs.

    Args:
        axes: axes in metres, east and north.
        workspace: a workspace of any shape.
        inset_m: how far inside the fence phi_safer of the geofence begins; None if that is not drawn.
    """
    fence, kept_out = workspace.outlines()
    if fence is None:
        axes.set_facecolor(INSIDE)
    else:
        axes.add_patch(Polygon(fence, fc=INSIDE if inset_m is None else STRIP, ec="none"))
    for inner in workspace.inset(inset_m) if inset_m is not None else ():
        axes.add_patch(Polygon(inner, fc=INSIDE, ec=SOFT, lw=0.8, ls=(0, (5, 4))))
    for place in workspace.robots:
        charger = place.charger
        wide_m, deep_m = charger.high_x_m - charger.low_x_m, charger.high_y_m - charger.low_y_m
        low = charger.low_x_m, charger.low_y_m
        axes.add_patch(Rectangle(low, wide_m, deep_m, fc=CHARGER, ec=MODULES["battery"], lw=1.0))
    for outline in kept_out:
        axes.add_patch(Polygon(outline, fc=BOX, ec=BOX, lw=0.3, zorder=1.5))
    if fence is not None:
        axes.add_patch(Polygon(fence, fc="none", ec=INK, lw=1.8, zorder=1.6))
