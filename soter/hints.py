"""How to install what a backend needs; the one place that knows the distribution's name."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

DISTRIBUTION: Final = "soter-rta"
"""What SOTER is called on package indexes, where `soter` is somebody else's."""

_TREE: Final = Path(__file__).parents[1]


def install_command(extra: str) -> str:
    """Return the command that installs one of SOTER's extras, such as `pybullet`, from where SOTER itself came."""
    if (_TREE / "pyproject.toml").is_file():
        tree = "." if Path.cwd() == _TREE else str(_TREE)
        return f'pip install -e "{tree}[{extra}]"'
    origin = _origin()
    if Path(origin).is_absolute() and not Path(origin).exists():
        return f'pip install -e ".[{extra}]", in a clone of SOTER'
    return f'pip install "{origin}[{extra}]"'


def _origin() -> str:
    """The file that SOTER was installed from, as pip has noted it; else the name on an index."""
    try:
        noted = distribution(DISTRIBUTION).read_text("direct_url.json")
        url = urlsplit(json.loads(noted)["url"]) if noted else None
    except (PackageNotFoundError, ValueError, KeyError):
        return DISTRIBUTION
    path = unquote(url.path) if url is not None and url.scheme == "file" else ""
    return path or DISTRIBUTION
