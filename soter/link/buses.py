"""Buses by name. Nothing of a bus is imported before a mission asks for it."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any, Final

from pydantic import BaseModel

from soter.config import validate_options
from soter.errors import ConfigError, nearest
from soter.link.bus import Bus

BUILT_IN: Final[Mapping[str, str]] = {"zenoh": "soter.adapters.zenoh.bus:ZenohBus"}


def bus_class(name: str, source: str | None = None) -> type[Bus]:
    """Import and return a bus.

    Args:
        name: a built-in name, or `module:Class`.
        source: the mission file, for error messages.

    Raises:
        ConfigError: there is none of that name, or what is there is none.
    """

    def refused(why: str) -> ConfigError:
        return ConfigError(why, source=source, key="distribution.via")

    module_name, colon, class_name = BUILT_IN.get(name, name).partition(":")
    if not (colon and class_name.isidentifier() and all(part.isidentifier() for part in module_name.split("."))):
        known = ", ".join(BUILT_IN)
        raise refused(
            f"unknown bus '{name}'{nearest(name, [*BUILT_IN])}; known are {known}, or a class as 'module:Class'"
        )
    try:
        found: Any = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as failure:
        raise refused(f"bus '{name}': cannot import '{module_name}' ({failure})") from failure
    model = getattr(found, "options_model", None)
    calls = ("open", "publish", "subscribe", "close")
    if not (isinstance(model, type) and issubclass(model, BaseModel) and all(hasattr(found, call) for call in calls)):
        raise refused(
            f"bus '{name}': '{class_name}' in '{module_name}' is no bus; it needs options_model, {', '.join(calls)}"
        )
    kind: type[Bus] = found
    return kind


def open_bus(name: str, common: Mapping[str, Any], own: Mapping[str, Any], process: str, source: str | None) -> Bus:
    """Open a bus for one process.

    Args:
        name: which bus.
        common: the options of all processes, `[distribution] bus`.
        own: those that this process has in their place.
        process: its name.
        source: the mission file, for error messages.

    Raises:
        ConfigError: an option that the bus does not have or allow.
        BackendError: it cannot be opened.
    """
    kind = bus_class(name, source)
    key = f"distribution.processes.{process}.bus" if own else "distribution.bus"
    return kind.open(validate_options(kind.options_model, {**common, **own}, source, key))
