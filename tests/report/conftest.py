"""Runs made up for pictures: two robots that cross a room, watched by two modules."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.record.tracks import RunTracks, Track
from soter.rta import SwitchRecord
from tests.report.chromium import chromium
from tests.report.pages import DURATION_S, Made, page_of

DRIVERS = ("AC", "collision", "geofence")


def make_track(robot_id: int, drivers: str, period_s: float = 1.0) -> Track:
    """A robot that drives east at 0.1 m a sample; `drivers` has a digit for each sample."""
    count = len(drivers)
    return Track(
        array("d", (index * period_s for index in range(count))),
        array("d", (0.1 * index for index in range(count))),
        array("d", (1.0 * robot_id for _ in range(count))),
        array("d", (1.0 - 0.01 * index for index in range(count))),
        array("b", map(int, drivers)),
    )


def make_run(robots: int = 2, drivers: str = "1000200011", period_s: float = 1.0) -> RunTracks:
    """Robots that all do the same, each in its lane."""
    places = tuple(
        RobotPlace(index, 0.0, 1.0 * index, Box(0.0, index - 0.2, 0.4, index + 0.2, 0.0))
        for index in range(1, robots + 1)
    )
    room = Workspace(5.0, robots + 2.0, (Box(2.0, 0.2, 3.0, 0.6),), places)
    names = [None, *DRIVERS[1:]]
    switches = [
        SwitchRecord(index * period_s, robot, names[int(before)], names[int(after)], "", "made up", ())
        for robot in range(1, robots + 1)
        for index, (before, after) in enumerate(pairwise(drivers), start=1)
        if before != after
    ]
    tracks = {robot: make_track(robot, drivers, period_s) for robot in range(1, robots + 1)}
    return RunTracks(room, DRIVERS, tracks, switches, 0.5)


@pytest.fixture
def run() -> RunTracks:
    """Two robots for nine seconds."""
    return make_run()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, one for all tests of a process; see `tests.report.chromium`."""
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A run of four minutes; robot 2 has so little charge that it has to drive home."""
    return page_of(tmp_path_factory.mktemp("pages"), duration_s=DURATION_S, battery__initial={"2": 0.17})


@pytest.fixture(scope="session")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Robots that nobody holds back, sent to where they must not go."""
    return page_of(tmp_path_factory.mktemp("hostile"), duration_s=120.0, targets="hostile", rta__enabled=False)
