"""`soter workspace`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soter.cli.exits import ExitCode, Force, guard
from soter.cli.option import option, switch
from soter.cli.plain import emit
from soter.errors import ConfigError, option_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.config import MissionFile
    from soter.geometry.grid import GridMap
    from soter.geometry.site import GeoOrigin
    from soter.geometry.workspace import Point, Ring, Workspace

EXAMPLES = """Examples:
  soter workspace examples/surveillance.xml --picture room.png
  soter workspace examples/worlds/harbour.geojson --to harbour.plan
  soter workspace examples/worlds/l-hall.toml --to hall.kml --origin 47.3977,8.5456
  soter workspace examples/worlds/flat-patrol.toml
Exit codes:
  0  robots can use it
  1  they cannot: no body fits, a station cannot be reached from the first, there is none (but in a map, whose mission
     gives them), or, of a mission, `soter check` would refuse it before any trial
  2  bad input: what is wrong is listed, by feature
  3  a file could not be written
"""

_LOOKS = 60
"""Number of places along the longer side at which it is checked whether a body fits."""

_WRITTEN = (".xml", ".toml", ".geojson", ".json", ".plan", ".kml")


def workspace(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A workspace: .xml, .toml, .geojson, .plan, .kml, a map's .yaml; or a mission, for what it names.",
        ),
    ],
    to: Annotated[Path | None, option("FILE", "Write it as .xml, .toml, .geojson, .plan or .kml.")] = None,
    origin: Annotated[str | None, option("LAT,LON", "Where its point (0, 0) is, if it does not say so.")] = None,
    picture: Annotated[Path | None, option("FILE.png", "Draw it.")] = None,
    json: Annotated[bool, switch("--json", "Print what was found as JSON.")] = False,
    radius: Annotated[float, option("METRES", "Radius of the robots' bodies.", min=0.0)] = 0.105,
    clearance: Annotated[
        float, option("METRES", "What ways keep from what is kept out of, and the fence.", min=0.0)
    ] = 0.15,
    force: Force = False,
) -> None:
    """Show a workspace, check it, convert it, draw it: where a body fits, and which stations can be reached."""
    with guard():
        from json import dumps

        from soter.cli.console import make_console
        from soter.cli.outputs import Outputs, unwritten
        from soter.geometry.writing import left_out

        if origin is not None and to is None:
            raise option_error("--origin", "it says where on earth to write the workspace; allowed with --to")
        files = Outputs({"--to": to, "--picture": picture}, (file,), force=force)
        made, mission = _read(file)
        # All outputs are made before the first one is written.
        converted = b"" if to is None else _converted(made, file, to, origin)
        drawn = b"" if picture is None else _drawn(made)
        found = _found(made, radius, clearance)
        if mission is not None:
            found["refused"] += _refused(mission, made)
        if to is not None:
            found["left_out"] = left_out(made, to.suffix.lower())
        with unwritten("it"):
            files.write("--to", lambda: converted)
            files.write("--picture", lambda: drawn)
        if json:
            emit(dumps(found, indent=2))
        else:
            console = make_console()
            lines = [(key, _words(value)) for key, value in found.items() if key != "refused"]
            lines += [("refused", why) for why in found["refused"] or ["none"]]
            for key, words in [*lines, *(("written", str(path)) for path in (to, picture) if path is not None)]:
                console.print(f"{key:<18} {words}", soft_wrap=True, highlight=False, markup=False)
        if found["unreachable"] or found["refused"]:
            raise typer.Exit(ExitCode.VIOLATION)


def _read(file: Path) -> tuple[Workspace, MissionFile | None]:
    """Read a workspace, or that of a mission file, with the stations and starts that the mission gives."""
    from soter.cli.overrides import load_with_engine
    from soter.geometry.reading import read_workspace
    from soter.problems import key_lines, read_limited

    if file.suffix == ".toml":
        text = read_limited(file, "workspace file").decode(errors="replace")
        if ("workspace",) in key_lines(text):
            mission = load_with_engine(file, {})
            return mission.read_workspace(), mission
    return read_workspace(file, inhabited=False), None


def _refused(mission: MissionFile, made: Workspace) -> list[str]:
    from soter.check.mission import refused
    from soter.errors import SoterError

    try:
        return list(refused(mission, made))
    except SoterError as failure:
        # The workspace is shown and drawn all the same: it may be what is wrong.
        return [str(failure)]


def _drawn(made: Workspace) -> bytes:
    from soter.report.ground import workspace_png

    return workspace_png(made)


def _words(value: object) -> str:
    if isinstance(value, dict):
        return "; ".join(f"{key}: {_words(inner)}" for key, inner in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return "none" if value is None else str(value)


def _found(made: Workspace, radius_m: float, clearance_m: float) -> dict[str, Any]:
    from soter.geometry.site import Site
    from soter.stack.routes import Routes
    from soter.stack.site_terrain import terrain_of

    low_x, low_y, high_x, high_y = made.bounds
    step_m = max(high_x - low_x, high_y - low_y) / _LOOKS
    columns, rows = max(1, round((high_x - low_x) / step_m)), max(1, round((high_y - low_y) / step_m))
    inside = [
        at
        for column in range(columns)
        for row in range(rows)
        if made.contains(*(at := (low_x + (column + 0.5) * step_m, low_y + (row + 0.5) * step_m)))
    ]

    def is_free(at: Point) -> bool:
        return made.clearance_m(*at, radius_m) >= clearance_m

    free = sum(map(is_free, inside))
    fence, kept_out = made.outlines()
    stations = {place.id: place.charger.centre for place in made.robots}
    ways = {}
    if stations:
        routes = Routes(terrain_of(made, radius_m), next(iter(stations.values())), clearance_m, clearance_m)
        ways = {robot_id: routes.distance_m(*at) for robot_id, at in stations.items()}
    origin, grid = (made.plan.origin, made.plan.map) if isinstance(made, Site) else (None, None)
    refused = []
    # Narrow ways may lie between the places that are looked at.
    if not free and not any(map(is_free, stations.values())):
        refused.append(f"nothing is free: no body of a radius of {radius_m:g} m keeps {clearance_m:g} m from areas")
    if not stations and grid is None:
        refused.append("there is no station in it, and every robot needs one to charge on; a mission may give them")
    return {
        "shape": "map" if grid is not None else "polygons" if isinstance(made, Site) else "rectangle",
        "bounds_m": [round(each, 3) for each in made.bounds],
        "fence_corners": 0 if fence is None else len(fence),
        **_kept_out(kept_out, grid),
        "origin": None if origin is None else {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg},
        "free_percent": round(100.0 * free / max(1, len(inside)), 1),
        "stations": {robot_id: [round(x, 3), round(y, 3)] for robot_id, (x, y) in stations.items()},
        "way_m": {robot_id: round(way, 2) for robot_id, way in ways.items() if way < float("inf")},
        "unreachable": [robot_id for robot_id, way in ways.items() if way == float("inf")],
        "refused": refused,
    }


def _kept_out(rings: Sequence[Ring], grid: GridMap | None) -> dict[str, Any]:
    if grid is None:
        return {"keep_outs": len(rings), "corners": sum(map(len, rings))}
    occupied = grid.occupied()
    return {
        "cells": [grid.columns, grid.rows],
        "cell_m": grid.cell_m,
        "occupied_percent": round(100.0 * occupied.mean(), 1),
    }


def _converted(made: Workspace, file: Path, to: Path, origin: str | None) -> bytes:
    import json as json_text

    from soter.config.toml_text import toml
    from soter.geometry.writing import as_geojson, as_plan, as_tables
    from soter.geometry.writing_xml import as_kml, as_xml

    ending = to.suffix.lower()
    if ending not in _WRITTEN:
        raise ConfigError(f"it ends in '{to.suffix}', allowed: {', '.join(_WRITTEN)}", key="--to")
    if ending in (".xml", ".toml"):
        if origin is not None:
            raise option_error("--origin", f"{ending} does not hold it; allowed with --to: {', '.join(_WRITTEN[2:])}")
        return as_xml(made, str(file)) if ending == ".xml" else toml(as_tables(made)).encode()
    there = _origin(made, file, ending, origin)
    if ending == ".kml":
        return as_kml(made, there, str(file))
    content = as_plan(made, there) if ending == ".plan" else as_geojson(made, there)
    return json_text.dumps(content, indent=1).encode() + b"\n"


def _origin(made: Workspace, file: Path, ending: str, given: str | None) -> GeoOrigin:
    """Return the place of a workspace's point (0, 0): as it says itself, or as given."""
    from soter.geometry.earth import check_degrees
    from soter.geometry.site import GeoOrigin, Site

    own = made.plan.origin if isinstance(made, Site) else None
    if given is None:
        if own is None:
            raise ConfigError(
                f"it does not say where on earth its point (0, 0) is, which {ending} needs; give --origin LAT,LON, or "
                "write it as .toml",
                source=str(file),
            )
        return own
    if own is not None:
        raise option_error("--origin", f"{file} says itself where it is: {own.lat_deg:g},{own.lon_deg:g}")
    try:
        lat_deg, lon_deg = map(float, given.split(","))
    except ValueError as failure:
        raise option_error("--origin", f"it is '{given}', allowed: LAT,LON, such as 47.3977,8.5456") from failure
    if wrong := check_degrees("it", lat_deg, lon_deg):
        raise option_error("--origin", wrong)
    return GeoOrigin(lat_deg, lon_deg)
