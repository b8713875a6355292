"""The picture of a run: a PNG of the promised size, with what it should show in it."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
from array import array
from pathlib import Path

import numpy as np
import pytest

from soter.record.tracks import RunTracks
from soter.report.caption import Caption, Margins, Remark, Rule
from soter.sdk import Violation
from tests.project.source import ROOT
from tests.report.conftest import make_run

pytest.importorskip("matplotlib")

from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

from soter.report.colours import driver_colour
from soter.report.ground import SOFT
from soter.report.picture import HEIGHT_PX, MOST_ROWS, WIDTH_PX, draw_png, make_figure
from soter.report.plan import ALARM

CAPTION = Caption(
    title="warehouse: a test",
    figures=("AC in control 66.7 %", "4 disengagements", "1 violation"),
    alarming=True,
    details="seed 7",
    disengagements={"collision": 1, "geofence": 3},
    rules=(Rule("geofence", "1 ×", "-0.100 m", broken=True), Rule("battery", "0 ×", "12.0 %", broken=False)),
    safer_charge=0.85,
)


def texts(figure: Figure) -> list[str]:
    """Every text of a figure."""
    within = [text.get_text() for axes in figure.axes for text in axes.texts]
    return [text.get_text() for text in figure.texts] + within


def ways(figure: Figure) -> list[LineCollection]:
    """The robots' ways on the map."""
    return [artist for artist in figure.axes[0].collections if isinstance(artist, LineCollection)]


def size_of(png: bytes) -> tuple[int, int]:
    """Width and height from the header of a PNG."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    assert png[12:16] == b"IHDR"
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def test_it_is_a_png_of_the_promised_size(tmp_path: Path, run: RunTracks) -> None:
    file = tmp_path / "run.png"
    file.write_bytes(draw_png(run, CAPTION))
    png = file.read_bytes()
    assert size_of(png) == (WIDTH_PX, HEIGHT_PX) == (1600, 1200)
    assert png.endswith(b"IEND\xaeB`\x82")
    assert len(png) < 1_000_000


def test_the_same_run_gives_the_same_picture(run: RunTracks) -> None:
    assert draw_png(run, CAPTION) == draw_png(make_run(), CAPTION)


def test_the_caption_is_set(run: RunTracks) -> None:
    found = texts(make_figure(run, CAPTION))
    for expected in (CAPTION.title, CAPTION.details, "AC, by robot", "collision", "geofence", "67 %", "11 %",
                     "starting", "3 ×", "-0.100 m", "12.0 %", "charger", "given back to the AC"):  # fmt: skip
        assert expected in found
    assert any(all(figure in text for figure in CAPTION.figures) for text in found)


def test_a_robot_that_ends_where_it_began_shows_both(run: RunTracks) -> None:
    back = run.tracks[1].x_m
    back[-1] = back[0] + 0.02
    lines = make_figure(run, CAPTION).axes[0].lines
    discs = [line for line in lines if line.get_zorder() == 7]
    places = np.hstack([np.asarray(disc.get_data(), float) for disc in discs])
    assert places == pytest.approx(np.array([[0.0, 0.0, 0.9, 0.0], [1.0, 1.0, 2.0, 2.0]]))
    ring, start, end, other = (disc.get_markersize() for disc in discs)
    assert ring > start == end == other


def test_ways_are_coloured_by_who_was_in_control(run: RunTracks) -> None:
    found = ways(make_figure(run, CAPTION))
    # Two robots, three drivers each, and a piece while they were starting.
    assert len(found) == 8
    pieces = {(round(float(np.ravel(way.get_linewidth())[0]), 1), len(way.get_segments())) for way in found}
    assert pieces == {(1.1, 2), (2.4, 1)}
    colours = {tuple(np.ravel(way.get_color())[:3]) for way in found}
    assert len(colours) == 5
    assert to_rgb(SOFT) in colours


def test_a_time_line_is_grey_while_its_robot_is_starting(run: RunTracks) -> None:
    line = make_figure(run, CAPTION).axes[2]
    grey = [each for each in line.collections if colours_of(each) == {SOFT}]
    assert [np.asarray(path.vertices)[:, 0].max() for each in grey for path in each.get_paths()] == [1.0]


def test_every_robot_has_a_time_line(run: RunTracks) -> None:
    assert len(make_figure(run, CAPTION).axes) == 2 + 2
    assert len(make_figure(make_run(6), CAPTION).axes) == 2 + 6


def test_of_many_robots_the_first_have_time_lines_and_the_rest_is_counted() -> None:
    figure = make_figure(make_run(MOST_ROWS + 5), CAPTION)
    assert len(figure.axes) == 2 + MOST_ROWS
    assert "and 5 more robots" in texts(figure)


def test_of_a_long_run_the_end_is_drawn_and_said() -> None:
    figure = make_figure(make_run(2, "01" * 60, 60.0), CAPTION)
    assert "ways of the last 10 min" in texts(figure)
    assert all(len(segment) == 2 for way in ways(figure) for segment in way.get_segments())
    assert sum(len(way.get_segments()) for way in ways(figure)) == 2 * 10


def test_what_lies_outside_the_fence_is_on_the_map(run: RunTracks) -> None:
    run.tracks[1].y_m[3] = -2.5
    low, high = make_figure(run, CAPTION).axes[0].get_ylim()
    assert low < -2.5
    assert high > run.workspace.depth_m


def red_rings(figure: Figure) -> list[list[float]]:
    """Where red rings are on the map, in metres."""
    rings = [
        each for each in figure.axes[0].collections if isinstance(each, PathCollection) and colours_of(each) == {ALARM}
    ]
    return [
        place for each in rings if not len(each.get_facecolor()) for place in np.asarray(each.get_offsets()).tolist()
    ]


def red_ticks(line: Axes) -> list[tuple[float, float]]:
    """The stretches of a time line that have red over them."""
    bars = [each for each in line.collections if isinstance(each, PolyCollection) and colours_of(each) == {ALARM}]
    across = [np.asarray(path.vertices)[:, 0] for each in bars for path in each.get_paths()]
    return [(float(x.min()), float(x.max())) for x in across]


def colours_of(drawn: Collection) -> set[str]:
    return {to_hex(each).upper() for each in (*drawn.get_edgecolor(), *drawn.get_facecolor())}


@pytest.mark.parametrize("count", [1, 12, 40])
def test_violations_are_rings_on_the_map_and_ticks_over_the_time_lines(run: RunTracks, count: int) -> None:
    begins_s = [0.2 * index for index in range(count)]
    run.violations = tuple(Violation("geofence", (1,), begin_s, begin_s + 0.001) for begin_s in begins_s)
    figure = make_figure(run, CAPTION)
    assert np.array(red_rings(figure)) == pytest.approx(np.array([[0.1 * begin_s, 1.0] for begin_s in begins_s]))
    first, second = figure.axes[2:]
    ticks = red_ticks(first)
    assert [left for left, _ in ticks] == pytest.approx(begins_s)
    assert min(right - left for left, right in ticks) * first.get_window_extent().width / 9.0 > 2.0
    assert red_ticks(second) == []
    assert texts(figure).count("began to break a rule") == 1


def test_a_violation_of_two_robots_is_marked_at_both_and_may_last_to_the_end(run: RunTracks) -> None:
    run.violations = (Violation("collision", (1, 2), 3.0, None),)
    figure = make_figure(run, CAPTION)
    assert np.array(red_rings(figure)) == pytest.approx(np.array([[0.3, 1.0], [0.3, 2.0]]))
    assert [red_ticks(line) for line in figure.axes[2:]] == [[(3.0, 9.0)], [(3.0, 9.0)]]


def test_without_violations_nothing_is_red(run: RunTracks) -> None:
    figure = make_figure(run, CAPTION)
    assert red_rings(figure) == []
    assert [red_ticks(line) for line in figure.axes[2:]] == [[], []]
    assert "began to break a rule" not in texts(figure)


@pytest.mark.parametrize("robots", [1, 2, 6, 64])
def test_the_map_is_true_to_scale_and_inside_the_page(robots: int) -> None:
    figure = make_figure(make_run(robots), CAPTION)
    plan = figure.axes[0]
    box = plan.get_window_extent()
    (left, right), (low, high) = plan.get_xlim(), plan.get_ylim()
    assert box.width / (right - left) == pytest.approx(box.height / (high - low))
    for axes in figure.axes:
        page = axes.get_position()
        assert 0.0 < page.x0 < page.x1 < 1.0
        assert 0.0 < page.y0 < page.y1 < 1.0


def test_nothing_of_the_key_runs_over_its_end() -> None:
    for robots in (1, 2, 6, 10):
        key = make_figure(make_run(robots), CAPTION).axes[1]
        bottom = key.get_ylim()[0]
        assert max(float(text.get_position()[1]) for text in key.texts) < bottom


@pytest.mark.parametrize("samples", ["", "0"])
def test_a_run_that_hardly_began_can_be_drawn(samples: str) -> None:
    assert size_of(draw_png(make_run(2, samples), CAPTION)) == (WIDTH_PX, HEIGHT_PX)


def test_without_caption_modules_and_batteries_it_can_be_drawn() -> None:
    run = make_run(1, "0000")
    run.drivers, run.safer_inset_m = ("AC",), None
    run.tracks[1].battery = array("d", [math.nan] * 4)
    figure = make_figure(run, Caption())
    assert "charge unknown" in texts(figure)
    assert "fence" in texts(figure)
    assert size_of(draw_png(run)) == (WIDTH_PX, HEIGHT_PX)


def test_modules_have_colours_of_their_own() -> None:
    known = {driver_colour(name) for name in ("collision", "obstacle", "geofence", "battery")}
    assert len(known) == 4
    assert driver_colour("my own module") not in known


def test_the_global_state_of_matplotlib_is_left_alone() -> None:
    program = (
        "import sys, matplotlib\n"
        # Asking for all of them would load pyplot.
        "names = ['font.size', 'font.family', 'axes.linewidth']\n"
        "matplotlib.rcParams['font.size'] = 3.0\n"
        "before = [matplotlib.rcParams[name] for name in names]\n"
        "from tests.report.conftest import make_run\n"
        "from soter.report.picture import draw_png\n"
        "draw_png(make_run())\n"
        "assert [matplotlib.rcParams[name] for name in names] == before\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.stderr == ""


def test_the_edge_of_a_rule_and_what_happened_at_it_are_on_the_plan(run: RunTracks) -> None:
    xs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    rule = Margins(xs, xs[:4], [[x - 2.5 for x in xs] for _ in range(4)], "where it is broken")
    remarks = (Remark(1.0, 1.0, "it took over", broken=False), Remark(2.5, 1.0, "broken", broken=True))
    plan = make_figure(run, Caption(rule=rule, remarks=remarks)).axes[0]
    edges = [each for each in plan.collections if isinstance(each, ContourSet) and not each.filled]
    corners = np.concatenate([np.asarray(path.vertices) for each in edges for path in each.get_paths()])
    assert len(corners) > 1
    assert np.allclose(corners[:, 0], 2.5)
    assert {text.get_text() for text in plan.texts} >= {"it took over", "broken", "red: where it is broken"}
