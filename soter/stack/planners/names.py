"""Planners by name: the built-in ones, or any other as `module:Class`. Nothing is imported before it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Final

from soter.config import validate_options
from soter.errors import BackendUnavailable, ConfigError, nearest
from soter.geometry.workspace import Workspace
from soter.stack.planners.base import Planner, PlanRequest, PlanResult

DEFAULT_PLANNER = "ompl-bitstar"

BUILT_IN: Mapping[str, str] = {
    "ompl-bitstar": "soter.stack.planners.sampling:BITstar",
    "ompl-rrtstar": "soter.stack.planners.sampling:RRTstar",
    "ompl-rrtconnect": "soter.stack.planners.sampling:RRTConnect",
    "straight-line": "soter.stack.planners.base:StraightLine",
}

TRUSTED = frozenset({"straight-line"})
"""Planners that are part of SOTER, cannot fail and take microseconds: they may run in the mission's process."""

INSTALL_HINT = "pip install 'soter-rta[ompl]'"


class PlannerUnavailable(BackendUnavailable):
    """The planner exists, but a library that it needs is missing; the message says what to install."""


def check_name(name: str) -> None:
    """Raise ConfigError unless `name` is a built-in planner or has the form `module:Class`. Imports nothing."""
    if name in BUILT_IN:
        return
    module, colon, cls = name.partition(":")
    if colon and cls.isidentifier() and all(part.isidentifier() for part in module.split(".")):
        return
    known = ", ".join(BUILT_IN)
    raise ConfigError(
        f"unknown planner '{name}'{nearest(name, list(BUILT_IN))}; known are {known}, or a class as 'module:Class'"
    )


def planner_class(name: str) -> type[Planner]:
    """Import and return a planner class.

    Args:
        name: a built-in name, or `module:Class`.

    Raises:
        ConfigError: there is no such planner, or what is there is not a `Planner`.
        PlannerUnavailable: a library that it needs is not installed.
    """
    check_name(name)
    module_name, _, class_name = BUILT_IN.get(name, name).partition(":")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        if name in BUILT_IN:
            hint = f"planner '{name}' needs OMPL, which cannot be imported ({error}); install it with {INSTALL_HINT}"
            raise PlannerUnavailable(hint) from error
        raise ConfigError(f"planner '{name}': cannot import '{module_name}' ({error})") from error
    found = getattr(module, class_name, None)
    if found is None:
        close = nearest(class_name, [key for key, value in vars(module).items() if isinstance(value, type)])
        raise ConfigError(f"planner '{name}': module '{module_name}' has no '{class_name}'{close}")
    if not (isinstance(found, type) and issubclass(found, Planner)):
        raise ConfigError(f"planner '{name}': '{class_name}' is not a subclass of soter.stack.planners.Planner")
    return found


def build_planner(
    name: str,
    workspace: Workspace,
    body_radius_m: float | Mapping[int, float],
    options: Mapping[str, Any] | None = None,
    source: str | None = None,
) -> Planner:
    """Build a planner in this process. The mission uses `PlanService`, which does this in a worker.

    Args:
        name: a built-in name, or `module:Class`.
        workspace: the known fence and boxes.
        body_radius_m: radius of the robots' round bodies, in metres; by id where they differ.
        options: the raw table `[planners.NAME]`.
        source: the mission file that the table is from, for error messages.

    Raises:
        ConfigError: unknown planner or bad option.
        PlannerUnavailable: a library that it needs is not installed.
    """
    cls = planner_class(name)
    checked = validate_options(cls.options_model, options or {}, source, f"planners.{name}")
    if isinstance(body_radius_m, Mapping):
        radii_m = set(body_radius_m.values())
        if len(radii_m) > 1:
            planners = {radius_m: cls(workspace, radius_m, checked) for radius_m in sorted(radii_m)}
            return _ForEach({robot_id: planners[radius_m] for robot_id, radius_m in body_radius_m.items()})
        (body_radius_m,) = radii_m
    return cls(workspace, body_radius_m, checked)


class _ForEach(Planner):
    """Asks for every robot the planner that is made for its body.

    Args:
        planners: by robot.
    """

    def __init__(self, planners: Mapping[int, Planner]) -> None:
        largest = max(planners.values(), key=lambda each: each.body_radius_m)
        super().__init__(largest.workspace, largest.body_radius_m, largest.options)
        self._planners: Final = planners

    def plan(self, request: PlanRequest) -> PlanResult:
        return self._planners[request.robot_id].plan(request)
