"""The bus between processes of one mission: keys and bytes, nothing promised. What must not get lost goes by a channel.

A bus is chosen by name, as backends are; the code that speaks a vendor's protocol lives in an adapter, of which nothing
is imported before a mission asks for it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, Protocol, Self

from pydantic import BaseModel

from soter.config import validate_options
from soter.errors import ConfigError, nearest

Hear = Callable[[str, bytes], None]
"""Called with a key and what was published under it, in a thread of the bus; it must be quick and must not raise."""


class Bus(Protocol):
    """Carries small messages to everybody who subscribes to their key. Messages may be lost, late, doubled, reordered.

    Keys are names with slashes between, without a leading one: `soter/alpha/status`.

    Attributes:
        options_model: what `open` takes, checked where a mission is read.
    """

    options_model: ClassVar[type[BaseModel]]

    @classmethod
    def open(cls, options: Any) -> Self:
        """Open it; others may not be there yet, and may come and go.

        Args:
            options: an instance of `options_model`.

        Raises:
            BackendUnavailable: a library is missing.
            RobotUnavailable: it cannot be opened; the message says why, and what to do.
        """

    def publish(self, key: str, payload: bytes) -> None:
        """Send it to whoever subscribes. Never waits and never raises; where it cannot be sent, it is lost."""

    def subscribe(self, key: str, hear: Hear) -> None:
        """Hear what is published under a key from now on. A `*` stands for any one part of a key."""

    def close(self) -> None:
        """Leave. Nothing is heard afterwards. Idempotent."""


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
