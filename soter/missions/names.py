"""Missions by name: a shipped one, or a class as `file.py:Class`, `file.py` or `module:Class`."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from typing import Final

from soter.config import MissionFile, validate_options
from soter.config.options import COMMAND_LINE
from soter.config.tables import SURVEILLANCE
from soter.errors import ConfigError
from soter.geometry.workspace import Workspace
from soter.loading import described, file_of, known_target, load_class
from soter.missions.mission import Mission
from soter.missions.script import Robot

BUILT_IN: Final[Mapping[str, str]] = {
    SURVEILLANCE: "soter.missions.surveillance:Surveillance",
    "waypoints": "soter.missions.waypoints:Waypoints",
}
"""The shipped missions."""


def mission_class(file: MissionFile) -> type[Mission]:
    """Import and return the class of the mission that a mission file names.

    Raises:
        ConfigError: there is no class of that name, or it is no mission.
    """
    name = file.mission.use

    def refused(message: str) -> ConfigError:
        return file.refusal("mission", message)

    found = load_class(name, known_target(name, BUILT_IN, "mission", refused, files=True), Mission, refused)
    if found.begin is Mission.begin and not inspect.iscoroutinefunction(found.run):
        raise refused(f"`run` of '{name}' is no coroutine; write it as `async def run(self, robot)`, without `yield`")
    if found.begin is Mission.begin and found.run is Mission.run:
        raise refused(f"'{name}' does nothing; give it an `async def run(self, robot)`, or `begin` for machines")
    if forgotten := not_awaited(found):
        raise refused(f"'{name}' does not wait for {forgotten}; without `await` before it, it does nothing")
    model: object = found.Options
    if not (isinstance(model, type) and issubclass(model, Mission.Options)):
        raise refused(f"`Options` of '{name}' is no subclass of soter.Mission.Options")
    return found


def not_awaited(found: type[Mission]) -> str:
    """Return, in words, a call of a coroutine in a script that is not awaited; empty if there is none.

    It is one if nothing is done with what it returns, or what only an answer has is asked of it. Python would only
    warn, once the run is under way, and a coroutine is true.
    """
    try:
        lines, first = inspect.getsourcelines(found)
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except (OSError, TypeError, SyntaxError):  # a class without source, such as one made at a prompt
        return ""
    robot = [*inspect.signature(found.run).parameters][1:2]
    around = {part: each for each in ast.walk(tree) for part in ast.iter_child_nodes(each)}
    for each in ast.walk(tree):
        match each:
            case ast.Call(ast.Attribute(ast.Name(owner), called)):
                of = Robot if [owner] == robot else found if owner == "self" else None
                if inspect.iscoroutinefunction(getattr(of, called, None)) and _taken_for_an_answer(each, around, tree):
                    return f"`{owner}.{called}(...)` in line {first + each.lineno - 1}"
    return ""


def _taken_for_an_answer(call: ast.Call, around: Mapping[ast.AST, ast.AST], tree: ast.Module) -> bool:
    """Return whether what a call returns is dropped, or asked as if it were an answer, also by the name it is given."""
    match around[call]:
        case ast.Assign([ast.Name(name)]):
            named = [each for each in ast.walk(tree) if isinstance(each, ast.Name) and each.id == name]
            return all(_asked(each, around) for each in named if isinstance(each.ctx, ast.Load))
    return _asked(call, around)


def _asked(value: ast.expr, around: Mapping[ast.AST, ast.AST]) -> bool:
    """Return whether a value is dropped, or asked whether it is true, compared, shown, or asked for a part."""
    match around[value]:
        case ast.If(test) | ast.While(test) | ast.IfExp(test) | ast.Assert(test):
            return test is value
        case ast.Expr() | ast.UnaryOp() | ast.BoolOp() | ast.Compare() | ast.FormattedValue() | ast.Attribute():
            return True
    return False


def options_of(file: MissionFile, found: type[Mission]) -> Mission.Options:
    """Return the options of a mission, whose class is `found`, from its table.

    Raises:
        ConfigError: an option is unknown or not allowed.
    """
    model, overridden = found.Options, file.overridden
    if file.targets is not None:
        if "targets" not in model.model_fields:
            option = "--targets" if overridden.get(("targets",)) == COMMAND_LINE else "the key"
            raise file.refusal("targets", f"mission '{file.mission.use}' draws no targets; leave {option} out")
        if ("targets",) in overridden:
            overridden = {**overridden, ("mission", "targets"): overridden["targets",]}
    return validate_options(model, file.options, file.source, "mission", overridden=overridden)


def checked(
    file: MissionFile, workspace: Workspace, body_radius_m: Mapping[int, float]
) -> tuple[type[Mission], Mission.Options]:
    """Return the class and the options of the mission that a mission file names; it can be done in the workspace.

    Args:
        file: the mission file.
        workspace: fence, obstacles and charging stations.
        body_radius_m: body radii of the robots, by id.

    Raises:
        ConfigError: see `mission_class` and `options_of`; or the mission cannot be done in the workspace.
    """
    found = mission_class(file)
    options = options_of(file, found)
    try:
        found.check_workspace(options, workspace, body_radius_m)
    except ConfigError as refusal:
        raise placed(file, refusal) from refusal
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code
        raise _failed(file, failure) from failure
    return found, options


def make_mission(file: MissionFile, workspace: Workspace, body_radius_m: Mapping[int, float]) -> Mission:
    """Return the mission that a mission file names, with the options of its table, for a workspace and robots.

    Raises:
        ConfigError: see `checked`; or making the mission fails.
    """
    found, options = checked(file, workspace, body_radius_m)
    try:
        return found(options)
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code
        raise _failed(file, failure) from failure


def placed(file: MissionFile, refusal: ConfigError) -> ConfigError:
    """Return what a mission refuses, with the place in the mission file of the key that it names."""
    key = refusal.key or "mission"
    return file.refusal(key, str(refusal).removeprefix(f"{key}: "))


def _failed(file: MissionFile, failure: BaseException) -> ConfigError:
    use = file.mission.use
    return file.refusal("mission", f"'{use}' failed: {described(failure, file_of(use))}")
