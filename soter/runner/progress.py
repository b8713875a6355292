"""What a run shows while it runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from soter.rta import RobotSupervisor
from soter.runner.metrics import Metrics


class RobotProgress(NamedTuple):
    """One robot at one moment.

    Attributes:
        robot_id: which robot.
        x_m: east.
        y_m: north.
        driver: "AC" or the safety module that drives.
        cause: why a module drives; empty otherwise.
        battery: charge from 0 to 1, or None.
        margins: by module, as its decision module saw it last, in the module's unit.
        targets_reached: so far.
        disengagements: so far.
    """

    robot_id: int
    x_m: float
    y_m: float
    driver: str
    cause: str
    battery: float | None
    margins: dict[str, float]
    targets_reached: int
    disengagements: int


class Progress(NamedTuple):
    """A run at one moment.

    Attributes:
        time_s: fleet time.
        duration_s: when it will end.
        wall_s: host time since the start.
        robots: all of them.
        violations: by rule so far, or None without truth.
    """

    time_s: float
    duration_s: float
    wall_s: float
    robots: tuple[RobotProgress, ...]
    violations: dict[str, int] | None


def robot_progress(robots: Sequence[RobotSupervisor], metrics: Metrics) -> tuple[RobotProgress, ...]:
    """Return how the robots are doing."""
    return tuple(
        RobotProgress(
            robot.robot_id,
            robot.situation.own.x_m,
            robot.situation.own.y_m,
            "AC" if robot.driver is None else robot.driver.name,
            "" if robot.driver is None else robot.driver.cause,
            robot.situation.own.battery,
            {module.name: module.margin for module in robot.modules},
            metrics.reached_by_robot[robot.robot_id],
            metrics.disengagements_by_robot[robot.robot_id],
        )
        for robot in robots
    )
