"""Adversaries by name: `adversary:NAME` for a built-in one, `module:Class` for any other. Imported when asked for."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import Final

from soter.config import Mission, validate_options
from soter.errors import nearest
from soter.stack.adversaries.base import Adversary, AdversaryOptions, AnyAdversary

MISSION: Final = "mission"
"""What a mission's `ac` says when its own machines are the ACs."""

PREFIX: Final = "adversary:"

BUILT_IN: Final[Mapping[str, str]] = {
    "random": "soter.stack.adversaries.random_goals:RandomGoals",
    "fastest-to-boundary": "soter.stack.adversaries.hugging:FastestToBoundary",
    "boundary-hugging": "soter.stack.adversaries.hugging:BoundaryHugging",
    "chase": "soter.stack.adversaries.chase:Chase",
    "pincer": "soter.stack.adversaries.pincer:Pincer",
    "search": "soter.stack.adversaries.search:Search",
    "flood": "soter.stack.adversaries.flood:Flood",
    "nan": "soter.stack.adversaries.nonsense:Nonsense",
    "frozen": "soter.stack.adversaries.nonsense:Frozen",
    "raises": "soter.stack.adversaries.nonsense:Raises",
}
"""The adversaries of this distribution."""


def adversary_class(mission: Mission) -> type[AnyAdversary]:
    """Import and return the class that a mission's `ac` names; it is not `MISSION`.

    Raises:
        ConfigError: there is none of that name, or what is there is no adversary.
    """
    name = mission.ac
    target = BUILT_IN.get(name.removeprefix(PREFIX), "") if name.startswith(PREFIX) else name
    module_name, colon, class_name = target.partition(":")
    if not (colon and class_name.isidentifier() and all(part.isidentifier() for part in module_name.split("."))):
        known = [MISSION, *(PREFIX + each for each in BUILT_IN)]
        listed = f"{nearest(name, known)}; known are {', '.join(known)}, or a class as 'module:Class'"
        raise mission.refusal("ac", f"unknown AC '{name}'{listed}")
    try:
        found = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as failure:
        raise mission.refusal("ac", f"AC '{name}': cannot import '{module_name}' ({failure})") from failure
    if not (isinstance(found, type) and issubclass(found, Adversary)) or inspect.isabstract(found):
        kind = "soter.stack.adversaries.Adversary"
        raise mission.refusal("ac", f"AC '{name}': '{class_name}' in '{module_name}' is not a subclass of {kind}")
    model = getattr(found, "options_model", None)
    if not (isinstance(model, type) and issubclass(model, AdversaryOptions)):
        kind = "soter.stack.adversaries.AdversaryOptions"
        raise mission.refusal("ac", f"AC '{name}': it needs an 'options_model' that is a subclass of {kind}")
    return found


def build_adversary(mission: Mission) -> AnyAdversary:
    """Return the adversary that a mission's `ac` names, with the options of its table.

    Raises:
        ConfigError: see `adversary_class`; or an option is unknown or not allowed.
    """
    found = adversary_class(mission)
    table = mission.ac.removeprefix(PREFIX)
    options = validate_options(
        found.options_model,
        mission.adversaries.get(table, {}),
        mission.source,
        f"adversaries.{_quoted(table)}",
        overridden=mission.overridden,
    )
    return found(options)


def _quoted(table: str) -> str:
    """Return a table's name as it stands in a dotted key; that of a class has dots in it."""
    return f'"{table}"' if "." in table or ":" in table else table
