"""A fleet stops every robot, whatever fails on the way."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from soter.clock import VirtualClock
from soter.sdk import Fleet, RobotSpec
from tests.sdk.fake import FakeRobot


class FakeFleet(Fleet):
    def __init__(self, robots: Sequence[FakeRobot]) -> None:
        super().__init__(VirtualClock(), robots, None)
        self.closed = 0

    def _close(self) -> None:
        self.closed += 1


def fleet_of(count: int) -> tuple[FakeFleet, list[FakeRobot]]:
    robots = [FakeRobot(RobotSpec(number, 0.0, 0.0, 0.0)) for number in range(1, count + 1)]
    for robot in robots:
        robot.init(1.0)
    return FakeFleet(robots), robots


def test_leaving_the_fleet_closes_all() -> None:
    fleet, robots = fleet_of(3)
    with fleet as entered:
        assert entered is fleet
    assert all("disconnect" in robot.calls for robot in robots)
    assert fleet.closed == 1


def test_robots_are_closed_although_one_fails_and_the_first_failure_is_raised() -> None:
    fleet, robots = fleet_of(4)
    robots[0].failing.add("disconnect")
    robots[2].failing.add("disconnect")
    with pytest.raises(OSError, match="disconnect failed"):
        fleet.close()
    assert all("disconnect" in robot.calls for robot in robots)
    assert fleet.closed == 1
    fleet.close()
    assert all(robot.calls.count("disconnect") == 1 for robot in robots)


def test_an_error_inside_stops_the_robots_and_goes_on() -> None:
    fleet, robots = fleet_of(2)
    with pytest.raises(KeyboardInterrupt), fleet:
        raise KeyboardInterrupt
    assert all("disconnect" in robot.calls for robot in robots)


def test_whoever_is_impatient_while_it_closes_keeps_no_robot_from_being_stopped() -> None:
    fleet, robots = fleet_of(3)

    def interrupted(timeout_s: float) -> None:
        raise KeyboardInterrupt

    robots[0]._disconnect = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        fleet.close()
    assert all("disconnect" in robot.calls for robot in robots[1:])
    assert fleet.closed == 1
