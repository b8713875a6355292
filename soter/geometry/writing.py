"""Writes workspaces as the tables of a TOML file, as GeoJSON, and as plans of QGroundControl."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from soter.errors import ConfigError
from soter.geometry.earth import Projection
from soter.geometry.site import GeoOrigin, Site
from soter.geometry.workspace import HEIGHT_M, Point, RobotPlace, Workspace
from soter.geometry.workspace_xml import STATION_SIDE_M

Place = Callable[[Point], tuple[float, float]]
"""Returns latitude and longitude in degrees of a point."""

RALLY_M: Final = 50.0
"""Height of rally points above the home, which robots on the ground ignore: QGroundControl's own."""

_LACKS: Final = {
    ".xml": ("names", "origin"),
    ".toml": ("origin",),
    ".plan": ("names", "heights", "sides of stations", "starts", "ids"),
    ".kml": ("heights", "sides of stations", "starts", "ids"),
}


def as_tables(workspace: Workspace) -> dict[str, Any]:
    """Return the tables that `soter.geometry.site_toml` reads: polygons, stations and starts, in metres.

    Raises:
        ConfigError: the workspace is a map.
    """
    fence, _ = workspace.outlines()
    tables: dict[str, Any] = {} if fence is None else {"fence": {"polygon": [list(at) for at in fence]}}
    tables["keep_out"] = [
        {"name": name, "height_m": height_m, "polygon": [list(at) for at in ring]}
        for name, height_m, ring in kept_out(workspace)
    ]
    tables["station"] = [
        {"x_m": x_m, "y_m": y_m, "side_m": station_side_m(place)}
        for place in workspace.robots
        for x_m, y_m in [place.charger.centre]
    ]
    tables["robot"] = [
        {"id": place.id, "x_m": place.x_m, "y_m": place.y_m, "heading_rad": place.heading_rad}
        for place in workspace.robots
    ]
    return tables


def as_geojson(workspace: Workspace, origin: GeoOrigin) -> dict[str, Any]:
    """Return the GeoJSON that `soter.geometry.geojson` reads, of a workspace whose point (0, 0) is at `origin`.

    Raises:
        ConfigError: the workspace is a map.
    """
    latlon = placing(origin)

    def place(at: Point) -> list[float]:
        return list(reversed(latlon(at)))

    fence, _ = workspace.outlines()
    features = [] if fence is None else [_feature(_ring(fence, place), soter="fence")]
    features += [
        _feature(_ring(ring, place), soter="keep_out", name=name, height_m=height_m)
        for name, height_m, ring in kept_out(workspace)
    ]
    for each in workspace.robots:
        station = _point(each.charger.centre, place)
        features.append(_feature(station, soter="station", side_m=station_side_m(each)))
    for each in workspace.robots:
        heading_deg = math.degrees(each.heading_rad)
        start = _point((each.x_m, each.y_m), place)
        features.append(_feature(start, soter="start", robot=each.id, heading_deg=heading_deg))
    return {"type": "FeatureCollection", "origin": [origin.lon_deg, origin.lat_deg], "features": features}


def as_plan(workspace: Workspace, origin: GeoOrigin) -> dict[str, Any]:
    """Return the plan that `soter.geometry.qgc` reads, and QGroundControl: its geofence, and stations as rally points.

    Raises:
        ConfigError: the workspace is a map.
    """
    place = placing(origin)
    fence, _ = workspace.outlines()
    rings = [] if fence is None else [(True, fence)]
    rings += [(False, tuple(ring)) for _, _, ring in kept_out(workspace)]
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            # A generic vehicle with a generic autopilot: QGroundControl opens no plan without them.
            "firmwareType": 0,
            "vehicleType": 0,
            "plannedHomePosition": [origin.lat_deg, origin.lon_deg, 0.0],
            "items": [],
        },
        "geoFence": {
            "version": 2,
            "polygons": [
                {"version": 1, "inclusion": inclusion, "polygon": [list(place(at)) for at in ring]}
                for inclusion, ring in rings
            ],
            "circles": [],
        },
        "rallyPoints": {
            "version": 2,
            "points": [[*place(each.charger.centre), RALLY_M] for each in workspace.robots],
        },
    }


def left_out(workspace: Workspace, ending: str) -> list[str]:
    """Return what a workspace has that the format of an ending has no place for, or that is not read from it."""
    robots, site = workspace.robots, isinstance(workspace, Site)
    has = {
        "names": site and bool(kept_out(workspace)),
        "heights": any(height_m != HEIGHT_M for _, height_m, _ in kept_out(workspace)),
        "sides of stations": any(not math.isclose(station_side_m(each), STATION_SIDE_M) for each in robots),
        "starts": any((each.x_m, each.y_m) != each.charger.centre or each.heading_rad != 0.0 for each in robots),
        "ids": [each.id for each in robots] != list(range(1, len(robots) + 1)),
        "origin": isinstance(workspace, Site) and workspace.plan.origin is not None,
    }
    return [each for each in _LACKS.get(ending, ()) if has[each]]


def placing(origin: GeoOrigin) -> Place:
    """Return what gives latitude and longitude of points of a workspace whose point (0, 0) is at `origin`."""
    project = Projection(origin, "the workspace to write")

    def place(at: Point) -> tuple[float, float]:
        lat_deg, lon_deg = project.place(*at)
        # Nine decimals are a tenth of a millimetre.
        return round(lat_deg, 9), round(lon_deg, 9)

    return place


def kept_out(workspace: Workspace) -> list[tuple[str, float, Sequence[Point]]]:
    """Return the name, the height in metres and the corners of every area that robots keep out of.

    Raises:
        ConfigError: the workspace is a map.
    """
    if isinstance(workspace, Site):
        if workspace.plan.map is not None:
            raise ConfigError("a map is made of cells, which no format of polygons and boxes has", key="--to")
        return [(area.name, area.height_m, area.ring) for area in workspace.plan.areas]
    _, rings = workspace.outlines()
    return [
        (f"box {number}", box.height_m, ring)
        for number, (box, ring) in enumerate(zip(workspace.boxes, rings, strict=True), start=1)
    ]


def station_side_m(place: RobotPlace) -> float:
    """Return the side of the square that a charging station is."""
    return place.charger.high_x_m - place.charger.low_x_m


def _ring(ring: Sequence[Point], place: Callable[[Point], list[float]]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [[place(at) for at in (*ring, ring[0])]]}


def _point(at: Point, place: Callable[[Point], list[float]]) -> dict[str, Any]:
    return {"type": "Point", "coordinates": place(at)}


def _feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
