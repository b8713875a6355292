"""Slow and strongly braked robots, whose legs would be millimetres, get somewhere under every safe controller."""

from __future__ import annotations

from dataclasses import replace

import pytest

from soter.stack.terrain import Point
from tests.sdk.fake import CAPABILITIES
from tests.stack.follower import CLEAR_M, FENCE_M, PEER_M, Controllers, Follower, Says
from tests.stack.ground import TERRAIN, clear_m, fence_m

SLOW = [(0.05, 3.0), (0.05, 1.0), (0.12, 1.0), (0.15, 3.0), (0.02, 10.0)]
NEAR_WALLS = [(0.1, 2.5), (0.05, 0.05), (3.13, 0.5), (1.9 + 0.15, 2.5)]


def slow(v_max_m_s: float, brake_m_s2: float) -> Controllers:
    return Controllers(capabilities=replace(CAPABILITIES, v_max_m_s=v_max_m_s, brake_m_s2=brake_m_s2))


@pytest.mark.parametrize(("v_max_m_s", "brake_m_s2"), SLOW)
@pytest.mark.parametrize("place", [(4.5, 0.5), (0.05, 2.5)])
def test_they_get_home(v_max_m_s: float, brake_m_s2: float, place: Point) -> None:
    made = slow(v_max_m_s, brake_m_s2)
    robot = Follower(made, made.home, place)
    robot.run(20.0)
    assert robot.home_m() < 0.03


@pytest.mark.parametrize(("v_max_m_s", "brake_m_s2"), SLOW)
@pytest.mark.parametrize("place", NEAR_WALLS)
def test_they_get_to_a_refuge(v_max_m_s: float, brake_m_s2: float, place: Point) -> None:
    made = slow(v_max_m_s, brake_m_s2)
    robot = Follower(made, made.retreat, place)
    robot.run(20.0)
    assert fence_m(*robot.place) >= FENCE_M - 0.03
    assert clear_m(TERRAIN, *robot.place) >= CLEAR_M - 0.03


@pytest.mark.parametrize(("v_max_m_s", "brake_m_s2"), SLOW)
def test_they_back_away(v_max_m_s: float, brake_m_s2: float) -> None:
    made = slow(v_max_m_s, brake_m_s2)
    peer = (4.2, 2.0)
    robot = Follower(made, made.back_away(Says(False)), (3.8, 2.0), peer)
    robot.run(20.0)
    assert ((robot.place[0] - peer[0]) ** 2 + (robot.place[1] - peer[1]) ** 2) ** 0.5 >= PEER_M
