"""Hashes all that the outcome of a run may depend on, so that runs of different sources are told apart."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from soter.record.about import versions

_PACKAGES: Final = ("soter", "soter_sim")
_SUFFIXES: Final = {".py", ".xml"}
_NO_SAY: Final = ("cli/", "report/", "live/", "conformance/", "campaign/report/")
"""Folders of SOTER on which the outcome of a run does not depend."""

_BESIDE: Final = {".py", ".xml", ".geojson", ".plan", ".kml", ".yaml", ".yml", ".pgm", ".png"}
_LIBRARIES: Final = ("numpy", "ompl", "pybullet")


@cache
def code_hash() -> str:
    """Return a hash over SOTER and the libraries that simulate robots and plan for them."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        root = Path(str(files(package)))
        for path in sorted(root.rglob("*")):
            name = path.relative_to(root).as_posix()
            if path.suffix in _SUFFIXES and not name.startswith(_NO_SAY):
                digest.update(f"{name}\0".encode())
                digest.update(path.read_bytes())
    installed = versions()
    for library in _LIBRARIES:
        digest.update(f"{library}=={installed.get(library, 'missing')}\0".encode())
    return digest.hexdigest()[:16]


def sources_hash(missions: Iterable[Path]) -> str:
    """Return a hash over that code, missions, and the workspaces and the user's classes beside them."""
    digest = hashlib.sha256(code_hash().encode())
    given = {mission.resolve() for mission in missions}
    beside = {path for mission in given for path in mission.parent.iterdir() if path.suffix in _BESIDE}
    for path in sorted(given | beside):
        digest.update(f"{path.name}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
