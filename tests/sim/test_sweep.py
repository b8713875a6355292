"""Exact swept geometry, against fine sampling."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.geometry.workspace import Box
from soter_sim.sweep import (
    chord_to_box,
    cross_rectangle,
    enter_disc,
    inside_disc,
    meet_box,
    nearest_to_origin,
    point_to_box,
)

EDGES = (1.0, 2.0, 1.5, 2.2)
BOX = Box(*EDGES)
SAMPLES = 400
RADIUS = 0.105
near_x, near_y, small = st.floats(0.5, 2.0), st.floats(1.5, 2.7), st.floats(-0.4, 0.4)
around = st.floats(-0.6, 0.6)
exact = settings(max_examples=300, deadline=None, derandomize=True)


@exact
@given(near_x, near_y)
def test_point_to_box_is_the_workspaces_distance(x: float, y: float) -> None:
    assert point_to_box(x, y, EDGES) == pytest.approx(BOX.distance_m(x, y), abs=1e-12)


@exact
@given(near_x, near_y, small, small)
def test_chord_to_box_is_the_least_distance_on_the_way(x: float, y: float, dx: float, dy: float) -> None:
    sampled = min(BOX.distance_m(x + dx * k / SAMPLES, y + dy * k / SAMPLES) for k in range(SAMPLES + 1))
    swept = chord_to_box(x, y, dx, dy, EDGES)
    if swept > 0.0:
        assert swept <= sampled + 1e-12
        assert sampled - swept <= math.hypot(dx, dy) / SAMPLES + 1e-12
    else:
        assert sampled <= math.hypot(dx, dy) / SAMPLES + 1e-12


@exact
@given(near_x, near_y, small, small)
def test_a_disc_stops_where_it_touches_a_box(x: float, y: float, dx: float, dy: float) -> None:
    start = BOX.distance_m(x, y) - RADIUS
    met = meet_box(x, y, dx, dy, EDGES, RADIUS)
    if start <= 1e-9:
        return
    least = min(BOX.distance_m(x + dx * k / SAMPLES, y + dy * k / SAMPLES) for k in range(SAMPLES + 1)) - RADIUS
    if met <= 1.0:
        assert BOX.distance_m(x + dx * met, y + dy * met) == pytest.approx(RADIUS, abs=1e-9)
        # Nothing before it touches.
        for k in range(SAMPLES):
            part = met * k / SAMPLES
            assert BOX.distance_m(x + dx * part, y + dy * part) >= RADIUS - 1e-9
    else:
        assert least >= -1e-9


def test_in_contact_only_motion_towards_the_box_is_met() -> None:
    x = 1.0 - RADIUS
    assert meet_box(x, 2.1, 0.01, 0.0, EDGES, RADIUS) == 0.0
    assert meet_box(x, 2.1, 0.01, 0.01, EDGES, RADIUS) == 0.0
    assert meet_box(x, 2.1, -0.01, 0.0, EDGES, RADIUS) == math.inf
    assert meet_box(x, 2.1, 0.0, 0.01, EDGES, RADIUS) == math.inf


@exact
@given(around, around, small, small, st.floats(0.05, 0.4))
def test_disc_entry_and_interval(rx: float, ry: float, dx: float, dy: float, radius: float) -> None:
    def distance(part: float) -> float:
        return math.hypot(rx + dx * part, ry + dy * part)

    sampled = [distance(k / SAMPLES) for k in range(SAMPLES + 1)]
    coarse = math.hypot(dx, dy) / SAMPLES
    least = nearest_to_origin(rx, ry, dx, dy)
    assert least <= min(sampled) + 1e-12
    assert min(sampled) - least <= coarse + 1e-12
    inside = inside_disc(rx, ry, dx, dy, radius)
    if inside is None:
        assert min(sampled) >= radius - 1e-9
    else:
        first, last = inside
        for k, at in enumerate(sampled):
            if at < radius - 1e-9:
                assert first - 1e-9 <= k / SAMPLES <= last + 1e-9
            if first + 1e-6 < k / SAMPLES < last - 1e-6:
                assert at < radius + 1e-9
    if distance(0.0) > radius + 1e-6:
        entered = enter_disc(rx, ry, dx, dy, radius)
        if entered <= 1.0:
            assert distance(entered) == pytest.approx(radius, abs=1e-9)
            assert inside is None or inside[0] == pytest.approx(entered, abs=1e-6)
        else:
            assert min(sampled) >= radius - 1e-9


def test_a_line_crosses_a_rectangle_between_two_parameters() -> None:
    assert cross_rectangle(0.0, 2.1, 2.0, 0.0, EDGES) == pytest.approx((0.5, 0.75))
    first, last = cross_rectangle(0.0, 3.0, 2.0, 0.0, EDGES)
    assert first > last
    assert cross_rectangle(1.2, 2.1, 0.0, 0.0, EDGES) == (-math.inf, math.inf)
