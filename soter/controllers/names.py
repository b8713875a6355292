"""Controllers by name: `adversary:NAME` for a built-in adversary, `file.py:Class` or `module:Class` for any other."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from pydantic import BaseModel

from soter.config import MissionFile, validate_options
from soter.config.tables import SURVEILLANCE
from soter.controllers.base import Controller
from soter.errors import ConfigError, nearest
from soter.loading import described, file_of, known_target, load_class
from soter.problems import dotted

MISSION: Final = "mission"
"""Value of a mission's `ac` if its own machines are the ACs."""

PREFIX: Final = "adversary:"

ADVERSARIES: Final[Mapping[str, str]] = {
    "random": "soter.controllers.adversaries.random_goals:RandomGoals",
    "fastest-to-boundary": "soter.controllers.adversaries.hugging:FastestToBoundary",
    "boundary-hugging": "soter.controllers.adversaries.hugging:BoundaryHugging",
    "chase": "soter.controllers.adversaries.chase:Chase",
    "pincer": "soter.controllers.adversaries.pincer:Pincer",
    "search": "soter.controllers.adversaries.search:Search",
    "flood": "soter.controllers.adversaries.flood:Flood",
    "nan": "soter.controllers.adversaries.nonsense:Nonsense",
    "frozen": "soter.controllers.adversaries.nonsense:Frozen",
    "raises": "soter.controllers.adversaries.nonsense:Raises",
}
"""The shipped adversaries."""


def controller_class(mission: MissionFile) -> type[Controller]:
    """Import and return the class that a mission's `ac`, which is not `MISSION`, names.

    Raises:
        ConfigError: there is no class of that name, or it is no controller.
    """
    name, does = mission.ac, mission.mission.use

    def refused(message: str) -> ConfigError:
        return mission.refusal("ac", message)

    # On the command line a controller may replace the mission of a file.
    given = {key[0] for key in mission.overridden}
    if does != SURVEILLANCE and not ("ac" in given and "mission" not in given):
        raise refused(f"it is '{name}', but mission '{does}' commands the robots itself; allowed with it: '{MISSION}'")
    known = {PREFIX + each: target for each, target in ADVERSARIES.items()}
    found = load_class(name, known_target(name, {MISSION: "", **known}, "AC", refused, files=True), Controller, refused)
    if found.step is Controller.step and found.act is Controller.act:
        raise refused(f"it is '{name}', which defines neither step nor act")
    model: object = found.Options
    if not (isinstance(model, type) and issubclass(model, BaseModel)) or model.model_config.get("extra") != "forbid":
        allowed = 'a pydantic model that refuses unknown keys, as class Options(BaseModel, extra="forbid") does'
        kind = "a class, but not" if isinstance(model, type) else f"a {type(model).__name__}"
        raise refused(f"it is '{name}', whose Options is {kind}, allowed: {allowed}")
    return found


def refuse_unknown_tables(mission: MissionFile) -> None:
    """Raise ConfigError if a mission has a table of options for an adversary that there is not, whatever its ACs are.

    A table may be there for other runs of the mission, but one that is misspelt is for none.
    """
    for name in mission.adversaries:
        if name not in ADVERSARIES:
            known = f"allowed: {', '.join(ADVERSARIES)}; the options of other classes stand in [controllers.CLASS]"
            raise mission.refusal(dotted("adversaries", name), f"there is none{nearest(name, [*ADVERSARIES])}; {known}")


def options_of(mission: MissionFile, found: type[Controller]) -> BaseModel:
    """Return the options of a mission's controllers, whose class is `found`.

    Those of an adversary are in `[adversaries.NAME]`, those of any other class in `[controllers.CLASS]`.

    Raises:
        ConfigError: an option is unknown or not allowed.
    """
    name = mission.ac
    group, table, tables = "controllers", found.__name__, mission.controllers
    if name.startswith(PREFIX):
        group, table, tables = "adversaries", name.removeprefix(PREFIX), mission.adversaries
    elif table not in tables and (close := nearest(table, [*tables])):
        raise mission.refusal(group, f"there is no table for '{table}'{close}; an empty one will do")
    model: type[BaseModel] = found.Options
    return validate_options(
        model, tables.get(table, {}), mission.source, f"{group}.{table}", overridden=mission.overridden
    )


def build(
    mission: MissionFile, robot_ids: Collection[int], elsewhere: Collection[int] = ()
) -> dict[tuple[int, ...], Controller]:
    """Make the controllers that a mission's `ac` names, with the options of its table; return them by their robots.

    Args:
        mission: the mission.
        robot_ids: the robots that this process drives.
        elsewhere: the robots that other processes of the mission drive.

    Raises:
        ConfigError: see `controller_class` and `options_of`; a controller cannot be made; or one that has to drive all
            robots would only drive those of this process.
    """
    found, name = controller_class(mission), mission.ac
    if elsewhere and found.fleet and not found.per_process:
        robots = "robot" if len(elsewhere) == 1 else "robots"
        away = f"but {robots} {', '.join(map(str, sorted(elsewhere)))} of other processes cannot be driven from here"
        allowed = "all robots in one process, a class for one robot, or one with per_process = True"
        raise mission.refusal(
            "ac", f"it is '{name}', which drives all robots together (fleet = True), {away}; allowed: {allowed}"
        )
    options = options_of(mission, found)
    parts = [tuple(robot_ids)] if found.fleet else [(robot_id,) for robot_id in robot_ids]
    try:
        return {part: found(options) for part in parts}
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code
        cause = described(failure, file_of(name))
        raise mission.refusal("ac", f"it is '{name}', which cannot be made: {cause}") from failure
