"""Reads workspaces from files of any known format, told by the file's suffix."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot, site_of
from soter.geometry.workspace import Box, Workspace
from soter.geometry.workspace_xml import BODY_RADIUS_M, parse_room, parse_workspace
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
"""Modules whose `read(data, source)` returns a `Draft`, by suffix; `.xml`, SOTER's own format, is not among them."""

_OF_PLACES: Final = (".geojson", ".json", ".plan", ".kml")
_SHORTER: Final = "simplify its polygons to fewer corners"


def read_workspace(
    path: Path,
    *,
    phi_safer_m: float = 0.1,
    spacing_m: float = 0.5,
    body_radius_m: float = BODY_RADIUS_M,
    stations: Sequence[Spot] = (),
    starts: Sequence[Spot] = (),
    inhabited: bool = True,
) -> Workspace:
    """Read a workspace file of any known format.

    Args:
        path: the file.
        phi_safer_m: body clearance from which the obstacle module gives a robot to its AC; starts and stations must
            have more.
        spacing_m: the least distance between the centres of two starts, and of two stations.
        body_radius_m: radius of the smallest robot's body.
        stations: where robots charge, for a file without stations, such as a map.
        starts: where robots start, for such a file; without any they start on their stations.
        inhabited: whether there must be a station, which robots need.

    Raises:
        ConfigError: the file cannot be read or something in it is not allowed; all problems are listed.
    """
    ending, source = path.suffix.lower(), str(path)
    data = read_limited(path, "workspace file", shorter=_SHORTER if ending in _OF_PLACES else "")
    if ending in READERS:
        draft: Draft = importlib.import_module(READERS[ending]).read(data, source)
    # Any other suffix is read as SOTER's XML, whose reader then says what is wrong.
    elif stations or starts:
        draft = _draft_of_room(data, source)
    else:
        return parse_workspace(data, source, phi_safer_m=phi_safer_m, spacing_m=spacing_m, body_radius_m=body_radius_m)
    for key, own, given in (("station", draft.stations, stations), ("start", draft.starts, starts)):
        if given and own:
            raise ConfigError(f"{source} says itself where they are; allowed beside it: none", key=key)
    draft.stations += stations
    draft.starts += starts
    return site_of(
        draft, phi_safer_m=phi_safer_m, spacing_m=spacing_m, body_radius_m=body_radius_m, inhabited=inhabited
    )


def _draft_of_room(data: bytes, source: str) -> Draft:
    """Return a room of SOTER's XML as a draft, which can be given stations."""
    room = parse_room(data, source)
    draft = Draft(source)
    draft.fences.append(Outline("room", Box(0.0, 0.0, room.width_m, room.depth_m).ring))
    draft.keep_outs += [
        Outline(f"obstacle {number}", patch.box.ring, patch.box.height_m, patch.line)
        for number, patch in enumerate(room.obstacles, start=1)
    ]
    draft.stations += [
        Spot(f"charging station {number}", *patch.box.centre, line=patch.line)
        for number, patch in enumerate(room.stations, start=1)
    ]
    draft.starts += [
        Spot(f"robot {start.id}", start.x_m, start.y_m, start.id, start.heading_rad, line=start.line)
        for start in room.starts
    ]
    return draft
