"""Bodies fit: beside each other at the separation, where they start, and where they charge."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.check.mission import check_mission
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.specs import check_bodies
from tests.project.source import ROOT

SURVEILLANCE = ROOT / "examples" / "surveillance.toml"
WIDE = {"backends.mavlink.promise": {"body_radius_m": 0.25}, "backend": "mavlink"}


def mission(**rta: object) -> MissionFile:
    return load_mission(SURVEILLANCE, {f"rta.{key}": value for key, value in rta.items()})


def room(*starts: tuple[float, float], boxes: tuple[Box, ...] = ()) -> Workspace:
    """A room in which every robot starts at its station."""
    places = [
        RobotPlace(number, x, y, Box(x - 0.1, y - 0.1, x + 0.1, y + 0.1)) for number, (x, y) in enumerate(starts, 1)
    ]
    return Workspace(9.0, 9.0, boxes, tuple(places))


def refused(workspace: Workspace, radius_m: dict[int, float], asked: MissionFile | None = None) -> str:
    try:
        check_bodies(asked or mission(), workspace, radius_m)
    except ConfigError as failure:
        return str(failure)
    return ""


radii = st.floats(0.01, 0.6)
places = st.tuples(st.floats(0.5, 8.5), st.floats(0.5, 8.5))


@given(st.lists(st.tuples(places, radii), min_size=1, max_size=4), st.floats(0.05, 0.9))
def test_what_is_accepted_overlaps_nowhere(robots: list[tuple[tuple[float, float], float]], phi_safe_m: float) -> None:
    box = Box(4.0, 4.0, 5.0, 5.0)
    radius_m = {number: radius for number, (_, radius) in enumerate(robots, 1)}
    asked = mission(**{"collision.phi_safe_m": phi_safe_m, "collision.phi_safer_m": 2.0, "obstacle.phi_safer_m": 0.1})
    said = refused(room(*(place for place, _ in robots), boxes=(box,)), radius_m, asked)
    largest = sorted(radius_m.values())[-2:]
    apart = [
        (math.dist(one, other), r + s)
        for i, (one, r) in enumerate(robots) for other, s in robots[:i]
    ]  # fmt: skip
    fits = (
        (len(robots) == 1 or sum(largest) <= phi_safe_m)
        and all(box.distance_m(*place) - r >= 0.1 for place, r in robots)
        and all(distance >= max(phi_safe_m, bodies) for distance, bodies in apart)
    )
    assert fits == (not said)


def test_bodies_that_overlap_at_the_separation_are_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"rta\.collision\.phi_safe_m: it is 0\.3, but two bodies .* at least 0\.5"):
        check_mission(load_mission(SURVEILLANCE, WIDE))
    alone = {**WIDE, "rta.modules": ["obstacle", "geofence", "battery"]}
    assert "overlap at less" not in refused(
        room((1.0, 1.0), (3.0, 1.0)), {1: 0.25, 2: 0.25}, load_mission(SURVEILLANCE, alone)
    )


def test_a_start_or_a_station_that_is_too_near_says_so() -> None:
    box = (Box(1.3, 0.0, 2.0, 2.0),)
    assert "0.050 m from a box at its start" in refused(room((1.0, 1.0), boxes=box), {1: 0.25})
    assert not refused(room((1.0, 1.0), boxes=box), {1: 0.105})
    assert "the starts of robots 1 and 2 are 0.250 m apart" in refused(room((1.0, 1.0), (1.25, 1.0)), {1: 0.1, 2: 0.1})
