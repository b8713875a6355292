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


def add_margins(series: Mapping[int, Series], about: About, workspace: Workspace) -> None:
    """Add the rules' margins, by rule, to every sample of a run without modules."""
    separation_m, clearance_m = (_promised_m(about.mission, module) for module in ("collision", "obstacle"))
    radius_m = {each.robot_id: body_radius_m(each) for each in about.robots}
    places = {robot: (np.array(each.x_m), np.array(each.y_m)) for robot, each in series.items()}
    apart = {robot: np.full(len(x), np.inf) for robot, (x, _) in places.items()}
    for one, other in combinations(places, 2):
        count = min(len(apart[one]), len(apart[other]))
        (x, y), (other_x, other_y) = places[one], places[other]
        away = np.hypot(x[:count] - other_x[:count], y[:count] - other_y[:count])
        away -= max(separation_m, radius_m[one] + radius_m[other])
        for robot in (one, other):
            np.minimum(apart[robot][:count], away, out=apart[robot][:count])
    for robot, (x, y) in places.items():
        at = list(zip(x.tolist(), y.tolist(), strict=True))
        nearest = [workspace.clearance_m(*place, radius_m[robot] + clearance_m) for place in at]
        fence = [workspace.fence_m(*place) for place in at]
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
