"""How to install what a backend needs; the one place that knows the distribution's name."""

from __future__ import annotations

from typing import Final

INSTALL: Final = 'pip install "soter-rta[{extra}]"'
"""The command that installs an extra, with its name left open."""


def install_hint(extra: str) -> str:
    """Return the command that installs one of SOTER's extras, such as `pybullet`."""
    return INSTALL.format(extra=extra)
