"""How to install what a backend needs; the one place that knows the distribution's name."""

from __future__ import annotations

from typing import Final

DISTRIBUTION: Final = "soter-rta"
"""What SOTER is called on package indexes, where `soter` is somebody else's."""


def install_command(extra: str) -> str:
    """Return the command that installs one of SOTER's extras, such as `pybullet`."""
    return f'pip install "{DISTRIBUTION}[{extra}]"'
