"""Planners by name: built-in ones, or any other as `module:Class`. Planners are imported only when used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from soter.config.options import validate_options
from soter.errors import BackendUnavailable, ConfigError
from soter.geometry.workspace import Workspace
from soter.hints import install_command
from soter.loading import Refused, known_target, load_class
from soter.problems import dotted
from soter.stack.planners.base import Planner, PlannerOptions, PlanRequest, PlanResult

BUILT_IN: Mapping[str, str] = {
    "ompl-bitstar": "soter.stack.planners.sampling:BITstar",
    "ompl-rrtstar": "soter.stack.planners.sampling:RRTstar",
    "ompl-rrtconnect": "soter.stack.planners.sampling:RRTConnect",
    "straight-line": "soter.stack.planners.base:StraightLine",
}

TRUSTED = frozenset({"straight-line"})
"""Planners of SOTER that cannot fail and take microseconds: they may run in the mission's process."""


class PlannerUnavailable(BackendUnavailable):
    """The planner exists, but a library that it needs is missing; the message says what to install."""


def _refused(message: str) -> ConfigError:
    return ConfigError(message, key="planner")


def check_name(name: str, refused: Refused = _refused) -> None:
    """Raise ConfigError, made by `refused`, unless `name` is a built-in planner or has the form of a class.

    Imports nothing.
    """
    known_target(name, BUILT_IN, "planner", refused)


def planner_class(name: str, refused: Refused = _refused) -> type[Planner]:
    """Import and return a planner class.

    Args:
        name: a built-in name, or `module:Class`.
        refused: makes the error.

    Raises:
        ConfigError: there is no such planner, or the name is that of something else.
        PlannerUnavailable: a library that it needs is not installed.
    """
    try:
        found = load_class(name, known_target(name, BUILT_IN, "planner", refused), Planner, refused)
    except ConfigError as error:
        if name in BUILT_IN and isinstance(error.__cause__, ImportError):
            hint = f"planner '{name}' needs OMPL, which cannot be imported ({error.__cause__}); install it with: "
            raise PlannerUnavailable(hint + install_command("ompl")) from error
        raise
    model: object = found.options_model
    if not (isinstance(model, type) and issubclass(model, PlannerOptions)):
        raise refused(f"`options_model` of '{name}' is no subclass of soter.stack.planners.PlannerOptions")
    return found


@dataclass(frozen=True, slots=True)
class PlannerSpec:
    """A planner by name, and what it is built for.

    Attributes:
        name: a built-in name, or `module:Class`.
        workspace: the known fence and boxes.
        body_radius_m: radius of the robots' round bodies, in metres; by robot id if they differ.
        options: the raw table `[planners.NAME]`.
        source: the mission file with the table, for error messages.
        overridden: keys that did not come from it, and where they came from instead, likewise.
    """

    name: str
    workspace: Workspace
    body_radius_m: float | Mapping[int, float]
    options: Mapping[str, Any] = field(default_factory=dict)
    source: str | None = None
    overridden: Mapping[tuple[str, ...], str] = field(default_factory=dict)

    def build(self) -> Planner:
        """Build the planner in this process. The mission uses `PlanService`, which does this in a worker.

        Raises:
            ConfigError: unknown planner or bad option.
            PlannerUnavailable: a library that it needs is not installed.
        """
        kind, radii_m = planner_class(self.name), self.body_radius_m
        checked = validate_options(
            kind.options_model, self.options, self.source, dotted("planners", self.name), overridden=self.overridden
        )
        if not isinstance(radii_m, Mapping):
            return kind(self.workspace, radii_m, checked)
        planners = {radius_m: kind(self.workspace, radius_m, checked) for radius_m in sorted(set(radii_m.values()))}
        if len(planners) == 1:
            return next(iter(planners.values()))
        return _ForEach({robot_id: planners[radius_m] for robot_id, radius_m in radii_m.items()})


class _ForEach(Planner):
    """Passes each robot's requests to the planner built for its body."""

    def __init__(self, planners: Mapping[int, Planner]) -> None:
        largest = max(planners.values(), key=lambda each: each.body_radius_m)
        super().__init__(largest.workspace, largest.body_radius_m, largest.options)
        self._planners: Final = planners

    def plan(self, request: PlanRequest) -> PlanResult:
        return self._planners[request.robot_id].plan(request)
