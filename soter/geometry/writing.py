"""Writes workspaces as the tables of a TOML file, and as GeoJSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from soter.errors import ConfigError
from soter.geometry.earth import Projection
from soter.geometry.site import Site
from soter.geometry.workspace import Point, Workspace


def as_tables(workspace: Workspace) -> dict[str, Any]:
    """Return the tables that `soter.geometry.site_toml` reads: polygons, stations and starts, in metres.

    Raises:
        ConfigError: the workspace is a map.
    """
    fence, _ = workspace.outlines()
    tables: dict[str, Any] = {} if fence is None else {"fence": {"polygon": [list(at) for at in fence]}}
    tables["keep_out"] = [
        {"name": name, "height_m": height_m, "polygon": [list(at) for at in ring]}
        for name, height_m, ring in _kept_out(workspace)
    ]
    tables["station"] = [
        {"x_m": x_m, "y_m": y_m, "side_m": place.charger.high_x_m - place.charger.low_x_m}
        for place in workspace.robots
        for x_m, y_m in [place.charger.centre]
    ]
    tables["robot"] = [
        {"id": place.id, "x_m": place.x_m, "y_m": place.y_m, "heading_rad": place.heading_rad}
        for place in workspace.robots
    ]
    return tables


def as_geojson(workspace: Workspace, source: str) -> dict[str, Any]:
    """Return the GeoJSON that `soter.geometry.geojson` reads.

    Raises:
        ConfigError: the workspace is a map, or its geographic position is not known.
    """
    origin = workspace.plan.origin if isinstance(workspace, Site) else None
    if origin is None:
        raise ConfigError("it does not say where on earth it is, which GeoJSON needs; write it as TOML", source=source)
    project = Projection(origin, source)

    def place(at: Point) -> list[float]:
        lat_deg, lon_deg = project.place(*at)
        # Nine decimals are a tenth of a millimetre.
        return [round(lon_deg, 9), round(lat_deg, 9)]

    fence, _ = workspace.outlines()
    features = [] if fence is None else [_feature(_ring(fence, place), soter="fence")]
    features += [
        _feature(_ring(ring, place), soter="keep_out", name=name, height_m=height_m)
        for name, height_m, ring in _kept_out(workspace)
    ]
    for each in workspace.robots:
        side_m = each.charger.high_x_m - each.charger.low_x_m
        features.append(_feature(_point(each.charger.centre, place), soter="station", side_m=side_m))
    for each in workspace.robots:
        features.append(_feature(_point((each.x_m, each.y_m), place), soter="start", robot=each.id))
    return {"type": "FeatureCollection", "origin": [origin.lon_deg, origin.lat_deg], "features": features}


def _kept_out(workspace: Workspace) -> list[tuple[str, float, Sequence[Point]]]:
    if isinstance(workspace, Site):
        if workspace.plan.map is not None:
            raise ConfigError("a map is made of cells, which are written as neither TOML nor GeoJSON", key="--to")
        return [(area.name, area.height_m, area.ring) for area in workspace.plan.areas]
    _, rings = workspace.outlines()
    return [
        (f"box {number}", box.height_m, ring)
        for number, (box, ring) in enumerate(zip(workspace.boxes, rings, strict=True), start=1)
    ]


def _ring(ring: Sequence[Point], place: Callable[[Point], list[float]]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [[place(at) for at in (*ring, ring[0])]]}


def _point(at: Point, place: Callable[[Point], list[float]]) -> dict[str, Any]:
    return {"type": "Point", "coordinates": place(at)}


def _feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
