"""Computes the rules' margins from the robots' places, for a run without modules, which records none.

They are those of ground truth: the distance of a robot's centre to the fence, of its body to a box, and of two centres,
each less the distance that the mission promises.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from itertools import combinations
from typing import Any, Final

import numpy as np

from soter.geometry.workspace import Workspace
from soter.record.attachments import About, ModuleAbout, RobotAbout
from soter.record.content import Series

RULES: Final = ("collision", "obstacle", "geofence")


class RuleMargins:
    """Adds the rules' margins to the series of a run without modules."""

    def __init__(self, about: About, workspace: Workspace) -> None:
        self._workspace: Final = workspace
        self._separation_m: Final = _promised_m(about.mission, "collision")
        self._clearance_m: Final = _promised_m(about.mission, "obstacle")
        self._radius_m: Final = {each.robot_id: body_radius_m(each) for each in about.robots}

    def add(self, series: Mapping[int, Series]) -> None:
        """Add the margins of every sample to the series, by rule."""
        places = {robot: (np.array(each.x_m), np.array(each.y_m)) for robot, each in series.items()}
        apart = {robot: np.full(len(x), np.inf) for robot, (x, _) in places.items()}
        for one, other in combinations(places, 2):
            count = min(len(apart[one]), len(apart[other]))
            (x, y), (other_x, other_y) = places[one], places[other]
            away = np.hypot(x[:count] - other_x[:count], y[:count] - other_y[:count])
            away -= max(self._separation_m, self._radius_m[one] + self._radius_m[other])
            for robot in (one, other):
                np.minimum(apart[robot][:count], away, out=apart[robot][:count])
        for robot, (x, y) in places.items():
            radius_m = self._radius_m[robot] + self._clearance_m
            at, room = list(zip(x.tolist(), y.tolist(), strict=True)), self._workspace
            nearest = [room.clearance_m(*place, radius_m) for place in at]
            fence = [room.fence_m(*place) for place in at]
            for rule, margins in zip(RULES, (apart[robot].tolist(), nearest, fence), strict=True):
                series[robot].margins[rule] = array("d", margins)


def modules_of(robot: RobotAbout) -> tuple[ModuleAbout, ...]:
    """Return the modules whose margins a page shows for a robot; without modules, those of the rules."""
    return robot.modules or tuple(ModuleAbout(rule, 0.0, 0.0, "m") for rule in RULES)


def body_radius_m(robot: RobotAbout) -> float:
    """Return the radius of a robot's body; 0.1 m if it was not recorded."""
    return float(robot.capabilities.get("body_radius_m", 0.1))


def _promised_m(mission: Mapping[str, Any], module: str) -> float:
    """Return the distance below which a rule counts as broken in the mission, with or without modules."""
    found = mission.get("rta", {}).get(module, {}).get("phi_safe_m", 0.0)
    return float(found)
