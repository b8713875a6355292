"""Safety modules by name: shipped, registered by an installed distribution, or a function of the user's own.

All are declared in the same way, from a `ModuleKit` and a table of options.
"""

from __future__ import annotations

import copy
import inspect
import math
import typing
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from typing import Any, Final

from pydantic import BaseModel

from soter.config import MissionFile, validate_options
from soter.errors import ConfigError, IllFormedModule, account_of, nearest
from soter.loading import load_named
from soter.rta import RTAModule, Topic
from soter.rta.module import plain
from soter.stack.battery import GoHome
from soter.stack.certified_controller import CertifiedController
from soter.stack.module_kit import ModuleKit
from soter.stack.modules.usable import check_usable
from soter.stack.safe_controller import SafeController

ENTRY_POINT_GROUP: Final = "soter.modules"

BUILT_IN: Final[Mapping[str, str]] = {
    "collision": "soter.stack.modules.collision:declare",
    "obstacle": "soter.stack.modules.obstacle:declare",
    "geofence": "soter.stack.modules.geofence:declare",
    "battery": "soter.stack.modules.battery:declare",
}
"""The shipped modules. They are found even if SOTER is not installed, and nobody else can take their names."""

LETS_GO_S: Final = 30.0
"""Default `lets_go_s` of a user's module."""


def target_of(name: str) -> str:
    """Return the `package.module:function` that a name is registered for; the name itself if it is not registered."""
    if name in BUILT_IN:
        return BUILT_IN[name]
    if ":" in name:  # as most of users' are; to look through all installed packages takes much longer
        return name
    found = next(iter(entry_points(group=ENTRY_POINT_GROUP, name=name)), None)
    return name if found is None else found.value


def declare_module(mission: MissionFile, kit: ModuleKit, waypoint: Topic[Any]) -> RTAModule:
    """Return one module for one robot, under the name that the mission gives it.

    A function declares it: `declare(kit)` or `declare(kit, options)`, where the annotation of the second parameter is
    the model of the options. A ready-made `RTAModule` will do too; it is copied for every robot.

    Args:
        mission: its `rta` tables.
        kit: the robot's kit, with the module's name.
        waypoint: topic on which the robot's controllers publish.

    Raises:
        ConfigError: there is no such function, it takes other arguments, an option is not allowed, or what it returns
            is no module.
        IllFormedModule: raised by the function itself.
    """
    table = mission.rta.module.get(kit.name)
    options: Mapping[str, Any] | BaseModel
    if table is None:
        key, target, options = f"rta.{kit.name}", kit.name, getattr(mission.rta, kit.name)
    else:
        key, target, options = f"rta.module.{kit.name}", table.declare, table.options

    def refused(message: str) -> ConfigError:
        return mission.refusal(f"{key}.declare", message)

    named = target_of(target)
    if ":" not in named:
        registered = sorted({*BUILT_IN, *entry_points(group=ENTRY_POINT_GROUP).names})
        raise refused(
            f"no module is registered as '{target}', allowed: {', '.join(registered)}{nearest(target, registered)}"
        )
    function = load_named(named, refused)
    if isinstance(function, RTAModule):
        check_usable(function, kit.name, target, kit.timing, refused)
        try:
            return _copied(function, target, kit, waypoint, refused)
        except (ConfigError, KeyboardInterrupt):
            raise
        except BaseException as failure:  # foreign code
            raise refused(f"'{target}' cannot be copied for each robot: {account_of(failure)}") from failure
    if not callable(function):
        raise refused(f"'{target}' is a {type(function).__name__}, allowed: a function that takes a ModuleKit")
    arguments: list[Any] = [kit]
    model = _options_model(function, target, refused)
    if isinstance(options, BaseModel):
        arguments.append(options)
    elif model is not None:
        arguments.append(validate_options(model, options, mission.source, f"{key}.options"))
    elif options:
        raise refused(f"'{target}' takes no options, but `{key}.options` gives {', '.join(options)}")
    try:
        made = function(*arguments)
        if table is not None and isinstance(made, RTAModule):
            check_usable(made, kit.name, target, kit.timing, refused)
            if made.sc is kit.ac:
                raise IllFormedModule(
                    kit.name, "P2a", "its safe controller is kit.ac, the advanced controller: the two are exchanged"
                )
        bound = _bound(made, kit, kit.waypoint, waypoint) if isinstance(made, RTAModule) else None
    except (ConfigError, IllFormedModule, KeyboardInterrupt):
        raise
    except BaseException as failure:  # foreign code
        raise refused(f"'{target}' failed: {account_of(failure)}; this is a fault of that function") from failure
    if bound is None:
        raise refused(f"'{target}' returned a {type(made).__name__}, allowed: a soter.rta.RTAModule")
    return bound


def _bound(made: RTAModule, kit: ModuleKit, wanted: Topic[Any], waypoint: Topic[Any]) -> RTAModule:
    """Return the module with a safe controller that drives by certified legs: its own, or a wrapper around it."""
    # Numbers of other classes, such as NumPy's, would fail later, where they are printed or recorded.
    made = replace(
        made, delta_s=plain(made.delta_s), dwell_s=plain(made.dwell_s), keep=plain(made.keep),
        lets_go_s=plain(made.lets_go_s), peers_within_m=plain(made.peers_within_m),
    )  # fmt: skip
    if kit.name not in BUILT_IN and made.lets_go_s == math.inf:
        made = replace(made, lets_go_s=LETS_GO_S)
    if isinstance(made.sc, SafeController):
        # The shipped ones drive the return path themselves; of a user's, the wrapper keeps the contract.
        drives_home = kit.name in BUILT_IN or type(made.sc) is GoHome
        made.sc.waypoint = waypoint if drives_home else wanted
        if drives_home:
            return replace(made, name=kit.name)
    return replace(made, name=kit.name, sc=CertifiedController(made, kit, wanted, waypoint))


def _copied(
    declared: RTAModule, target: str, kit: ModuleKit, waypoint: Topic[Any], refused: Callable[[str], ConfigError]
) -> RTAModule:
    """Return a copy of a ready-made declaration for one robot; a copy, since its controller has state."""
    copied = copy.deepcopy(declared)
    topics = [value for value in vars(copied.sc).values() if isinstance(value, Topic)]
    if len(topics) != 1:
        raise refused(
            f"'{target}' is a declaration whose safe controller has {len(topics)} topics among its attributes, "
            "allowed: one, which it publishes on; or name a function that takes a ModuleKit"
        )
    return _bound(copied, kit, topics[0], waypoint)


def _options_model(
    function: Callable[..., Any], target: str, refused: Callable[[str], ConfigError]
) -> type[BaseModel] | None:
    """Return the options model of a declaring function, or None if it takes a kit only."""
    try:
        parameters = list(inspect.signature(function).parameters.values())
        hints = typing.get_type_hints(function)
    except (TypeError, ValueError, NameError) as failure:
        raise refused(f"the arguments of '{target}' cannot be read: {failure}") from failure
    if len(parameters) == 1:
        return None
    model = hints.get(parameters[1].name) if len(parameters) == 2 else None
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        raise refused(f"'{target}' has to be declare(kit) or declare(kit, options: a pydantic model)")
    return model
