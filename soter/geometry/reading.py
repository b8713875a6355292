"""Workspaces from files, whatever their format: the ending of a file's name says which."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from soter.errors import ConfigError
from soter.geometry.draft import Draft, site_of
from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import parse_workspace
from soter.problems import read_limited

READERS: Final[dict[str, str]] = {
    ".toml": "soter.geometry.site_toml",
    ".geojson": "soter.geometry.geojson",
    ".json": "soter.geometry.geojson",
    ".plan": "soter.geometry.qgc",
    ".kml": "soter.geometry.kml",
}
"""Modules whose `read(data, source)` returns a `Draft`, by the ending of the file; `.xml` is SOTER's own."""

FORMATS: Final = (".xml", *READERS)


def read_workspace(path: Path, *, phi_safer_m: float = 0.1, spacing_m: float = 0.5) -> Workspace:
    """Read a workspace file of any known format.

    Args:
        path: the file.
        phi_safer_m: body clearance from which the obstacle module lets a robot work; starts and stations must have
            more.
        spacing_m: the least distance between the centres of two starts, and of two stations.

    Raises:
        ConfigError: the file cannot be read or something in it is not allowed; all that is wrong is listed.
    """
    data, source = read_limited(path, "workspace file"), str(path)
    ending = path.suffix.lower()
    if ending in READERS:
        read: Callable[[bytes, str], Draft] = importlib.import_module(READERS[ending]).read
        return site_of(read(data, source), phi_safer_m=phi_safer_m, spacing_m=spacing_m)
    if ending in (".yaml", ".yml", ".pgm", ".png"):
        raise ConfigError(
            f"maps ({ending}) are not read yet; allowed: files that end in {', '.join(FORMATS)}", source=source
        )
    # A file of any other name is taken for SOTER's XML, which says what is wrong with it.
    return parse_workspace(data, source, phi_safer_m=phi_safer_m, spacing_m=spacing_m)
