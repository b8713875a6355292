"""Workspaces from files, whatever their format: the ending of a file's name says which."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from soter.errors import ConfigError
from soter.geometry.draft import Spot, site_of
from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import parse_workspace
from soter.problems import read_limited

READERS: Final[dict[str, str]] = {
    ".toml": "soter.geometry.site_toml",
    ".geojson": "soter.geometry.geojson",
    ".json": "soter.geometry.geojson",
    ".plan": "soter.geometry.qgc",
    ".kml": "soter.geometry.kml",
    ".yaml": "soter.geometry.ros_map",
    ".yml": "soter.geometry.ros_map",
}
"""Modules whose `read(data, source)` returns a `Draft`, by the ending of the file; `.xml` is SOTER's own."""


def read_workspace(
    path: Path,
    *,
    phi_safer_m: float = 0.1,
    spacing_m: float = 0.5,
    stations: Sequence[Spot] = (),
    starts: Sequence[Spot] = (),
    inhabited: bool = True,
) -> Workspace:
    """Read a workspace file of any known format.

    Args:
        path: the file.
        phi_safer_m: body clearance from which the obstacle module lets a robot work; starts and stations must have
            more.
        spacing_m: the least distance between the centres of two starts, and of two stations.
        stations: where robots charge, for a file that does not say so, such as a map.
        starts: where they start, likewise; without any they start on their stations.
        inhabited: whether there must be a station, as robots need it.

    Raises:
        ConfigError: the file cannot be read or something in it is not allowed; all that is wrong is listed.
    """
    data, source = read_limited(path, "workspace file"), str(path)
    ending = path.suffix.lower()
    # A file of an unknown name is taken for SOTER's XML, which says what is wrong with it.
    draft = importlib.import_module(READERS[ending]).read(data, source) if ending in READERS else None
    for key, own, given in (("station", draft and draft.stations, stations), ("start", draft and draft.starts, starts)):
        if given and (draft is None or own):
            raise ConfigError(f"{source} says itself where they are; allowed beside it: none", key=key)
    if draft is None:
        return parse_workspace(data, source, phi_safer_m=phi_safer_m, spacing_m=spacing_m)
    draft.stations += stations
    draft.starts += starts
    return site_of(draft, phi_safer_m=phi_safer_m, spacing_m=spacing_m, inhabited=inhabited)
