"""Judges the rules of a user's own modules by ground truth, since the world does not know them.

A world judges its own four rules at its own rate. A user's rule is only defined by its region, so this module evaluates
that region at the robots' true poses, read once a tick, and at speeds from two poses and the time between them. It uses
neither what the robots report nor what the decision modules concluded.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from soter.rta import Region, RobotSupervisor, RTAModule, Situation
from soter.rta.module import plain
from soter.sdk import Link, RobotState, Truth, Violation

logger = logging.getLogger(__name__)


class UserRules:
    """Judges users' rules by the truth after every tick.

    Args:
        truth: the world's ground truth.
        modules: the user's declarations, by robot id; those without a region cannot be judged.

    Attributes:
        names: the names of the rules that are judged.
        min_margin: the least margin so far, by name.
        margin: the margin at the last look, by robot id and name.
    """

    def __init__(self, truth: Truth, modules: Mapping[int, Sequence[RTAModule]]) -> None:
        self._truth: Final = truth
        self._rules: Final[list[tuple[int, str, Region]]] = [
            (robot_id, module.name, module.phi_safe)
            for robot_id, declared in modules.items()
            for module in declared
            if module.phi_safe is not None
        ]
        self.names: Final = tuple(dict.fromkeys(name for _, name, _ in self._rules))
        self.min_margin: dict[str, float] = {}
        self.margin: dict[tuple[int, str], float] = {}
        self._robots: Final = tuple(modules)
        self._before: dict[int, tuple[float, float, float]] = {}
        self._open: dict[tuple[str, int], float] = {}
        self._closed: list[Violation] = []
        self._last_s = math.nan
        self._failed: Final[set[str]] = set()

    def look(self, now_s: float, robots: Iterable[RobotSupervisor]) -> None:
        """Judge the time since the last look.

        `robots` are their supervisors, for the charge, which truth does not have.
        """
        if not self._rules:
            return
        elapsed_s = now_s - self._last_s
        self._last_s = now_s
        poses = {robot_id: self._truth.pose(robot_id) for robot_id in self._robots}
        before, self._before = self._before, poses
        if not before or not elapsed_s > 0.0:
            return
        charges = {robot.robot_id: robot.situation.own.battery for robot in robots}
        true = {
            robot_id: _true_state(robot_id, now_s, pose, before[robot_id], elapsed_s, charges[robot_id])
            for robot_id, pose in poses.items()
        }
        for robot_id, name, region in self._rules:
            situation = Situation(robot_id, true[robot_id], now_s)
            situation.peers = [state for other, state in true.items() if other != robot_id]
            self._judge(robot_id, name, self._margin(name, region, situation), now_s)

    def violations(self) -> tuple[Violation, ...]:
        """Return every interval in which a rule was broken; an interval that goes on has no end."""
        going_on = [Violation(name, (robot_id,), began_s, None) for (name, robot_id), began_s in self._open.items()]
        return (*self._closed, *going_on)

    def counts(self) -> dict[str, int]:
        """Return the number of violations by rule."""
        found = self.violations()
        return {name: sum(each.rule == name for each in found) for name in self.names}

    def _margin(self, name: str, region: Region, situation: Situation) -> float:
        """Return the region's margin; NaN, which counts as broken, if it raises."""
        try:
            return plain(region.margin(situation))
        except KeyboardInterrupt:
            raise
        except BaseException:
            if name not in self._failed:
                self._failed.add(name)
                logger.exception("the rule of '%s' cannot be judged", name)
            return math.nan

    def _judge(self, robot_id: int, name: str, margin: float, now_s: float) -> None:
        self.margin[robot_id, name] = margin
        self.min_margin[name] = min(self.min_margin.get(name, math.inf), margin)
        # Written so that NaN counts as broken.
        if not margin >= 0.0:
            self._open.setdefault((name, robot_id), now_s)
        elif (began_s := self._open.pop((name, robot_id), None)) is not None:
            self._closed.append(Violation(name, (robot_id,), began_s, now_s))


def _true_state(
    robot_id: int,
    now_s: float,
    pose: tuple[float, float, float],
    before: tuple[float, float, float],
    elapsed_s: float,
    battery: float | None,
) -> RobotState:
    x, y, heading = pose
    return RobotState(
        robot_id, now_s, now_s, x, y, 0.0, heading, (x - before[0]) / elapsed_s, (y - before[1]) / elapsed_s,
        math.remainder(heading - before[2], math.tau) / elapsed_s, battery, None, None, Link.UP,
    )  # fmt: skip
