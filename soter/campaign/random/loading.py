"""Classes by name, as the tables that mission files are checked with have them."""

from __future__ import annotations

import importlib
from typing import Any

from soter.faults import Fault


def named(target: str) -> Any:
    """Return what `module:name` stands for."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def fault_class(target: str) -> type[Fault[Any]]:
    """Return the class of a kind of fault."""
    found: type[Fault[Any]] = named(target)
    return found
