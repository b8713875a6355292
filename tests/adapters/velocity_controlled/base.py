"""What the first robot of `driving.ROOM` says of itself: the same, whatever carries it.

Times are the world's, by its own stamps: when something arrives also depends on what else the host has to do.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import pytest

from soter.adapters.velocity_controlled.motion import seconds
from soter.adapters.velocity_controlled.robot import ODOMETRY_S
from tests.waiting import wait_until


def says_where_it_stands(odometry: Sequence[Any], percentage: float) -> None:
    """It says where it is at its rate; it stands on its charger."""
    stamps_s = [seconds(each.header.stamp) for each in odometry]
    apart_s = [later_s - before_s for before_s, later_s in pairwise(stamps_s)]
    assert min(apart_s) > 0.0
    # Of several that are due at once, on a busy host, one is said.
    assert statistics.median(apart_s) == pytest.approx(ODOMETRY_S, rel=0.2)
    last = odometry[-1]
    position, turned = last.pose.pose.position, last.pose.pose.orientation
    assert (position.x, position.y) == pytest.approx((2.0, 2.5))
    assert 2.0 * math.atan2(turned.z, turned.w) == pytest.approx(0.4)
    assert (last.header.frame_id, last.child_frame_id) == ("robot1/odom", "robot1/base_link")
    assert 0.79 < percentage <= 1.0


def stops_by_itself(odometry: Sequence[Any], drive: Callable[[], bool]) -> None:
    """Without new velocities it stops: after its time-out, and braking.

    A busy host may be late to carry a velocity there or odometry back, and never early: the quickest of three counts.

    Args:
        odometry: all that it has said, oldest first.
        drive: says velocities until it is at speed, and returns whether it is.
    """
    took_s = []
    for _ in range(3):
        assert drive()
        said = len(odometry)
        wait_until(lambda: odometry[-1].twist.twist.linear.x == 0.0)
        silent_s = seconds(odometry[said - 1].header.stamp)
        stopped_s = next(seconds(each.header.stamp) for each in odometry[said:] if each.twist.twist.linear.x == 0.0)
        took_s.append(stopped_s - silent_s)
    assert 0.1 < min(took_s) < 0.2 + 0.2 + 0.3, took_s
