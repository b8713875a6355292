"""Packages whose names are loaded when they are first used: what needs few of them starts without the rest."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any


def lazily(package: str, homes: Mapping[str, Iterable[str]]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return a package's `__getattr__` and its `__dir__`, which lists its names, loaded or not, and nothing else.

    Args:
        package: its name.
        homes: by module, the names that the package has of it.
    """
    home_of = {name: home for home, names in homes.items() for name in names}

    def load(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(importlib.import_module(home_of[name]), name)

    return load, lambda: sorted({*vars(sys.modules[package])["__all__"], *home_of})
