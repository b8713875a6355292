"""Writes workspaces as XML: SOTER's own, for rectangles with boxes along their axes, and KML."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from soter.errors import ConfigError
from soter.geometry.kml import FENCE
from soter.geometry.site import GeoOrigin, Site
from soter.geometry.workspace import Box, Point, Workspace
from soter.geometry.workspace_xml import SLACK_M, parse_workspace
from soter.geometry.writing import kept_out, placing
from soter.problems import shown_value

OFF_M: Final = 1e-3
"""A polygon whose corners are this near to those of a rectangle along the axes is written as the rectangle."""

_NOT_IN_XML: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_xml(workspace: Workspace, source: str) -> bytes:
    """Return the XML that `soter.geometry.workspace_xml` reads; `source` names it in errors.

    Raises:
        ConfigError: the workspace is a map, or no rectangle from the origin with boxes along its axes, or XML does not
            allow it otherwise; what does not fit is named.
    """
    if isinstance(workspace, Site):
        workspace = _as_rectangle(workspace, source)
    root = Element("configuration")
    high_m = max([1.0, *(box.height_m for box in workspace.boxes)])
    SubElement(root, "dimension", _at(workspace.width_m, workspace.depth_m, high_m))
    robots = SubElement(root, "robots")
    for place in workspace.robots:
        robot = SubElement(robots, "robot", {"id": str(place.id)})
        SubElement(robot, "start", {**_at(place.x_m, place.y_m, 0.0), "heading": str(place.heading_rad)})
    _add_boxes(SubElement(root, "obstacles"), workspace.boxes)
    _add_boxes(SubElement(root, "charging_stations"), [place.charger for place in workspace.robots])
    data = _text(root)
    # The reader knows what else is not allowed: no robot, too many boxes, a station that reaches out of the fence.
    parse_workspace(data, source, phi_safer_m=-SLACK_M, spacing_m=0.0, body_radius_m=0.0)
    return data


def as_kml(workspace: Workspace, origin: GeoOrigin, source: str) -> bytes:
    """Return the KML that `soter.geometry.kml` reads, of a workspace whose point (0, 0) is at `origin`.

    Raises:
        ConfigError: the workspace is a map, or has areas but no fence, or a name that XML cannot hold.
    """
    place = placing(origin)

    def coordinates(ring: Sequence[Point], height_m: float = 0.0) -> str:
        return " ".join(f"{lon:.9f},{lat:.9f},{height_m:g}" for lat, lon in map(place, ring))

    root = Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = SubElement(root, "Document")
    fence, _ = workspace.outlines()
    areas = kept_out(workspace)
    if areas and fence is None:
        raise ConfigError(
            "it has no fence, and KML with areas needs one; allowed: .toml, .geojson, .plan", source=source, key="fence"
        )
    rings = [] if fence is None else [(FENCE, 0.0, fence)]
    rings += [(_area_name(name, source), height_m, tuple(ring)) for name, height_m, ring in areas]
    for name, height_m, ring in rings:
        polygon = SubElement(_placemark(document, name), "Polygon")
        SubElement(polygon, "extrude").text = "1"
        SubElement(polygon, "altitudeMode").text = "relativeToGround"
        edge = SubElement(SubElement(polygon, "outerBoundaryIs"), "LinearRing")
        SubElement(edge, "coordinates").text = coordinates((*ring, ring[0]), height_m)
    for each in workspace.robots:
        point = SubElement(_placemark(document, f"station {each.id}"), "Point")
        SubElement(point, "coordinates").text = coordinates([each.charger.centre])
    return _text(root)


def _as_rectangle(site: Site, source: str) -> Workspace:
    """Return a site as a rectangle with boxes; refuse it by the first thing that does not fit."""
    areas = kept_out(site)
    if site.plan.fence is None:
        raise _unfit(source, FENCE, "there is none")
    fence = _rectangle(source, FENCE, site.plan.fence, 0.0)
    if math.hypot(fence.low_x_m, fence.low_y_m) > OFF_M:
        raise _unfit(source, FENCE, f"its lowest corner is ({fence.low_x_m:g}, {fence.low_y_m:g}), not (0, 0)")
    width_m, depth_m = fence.high_x_m, fence.high_y_m
    boxes = [_rectangle(source, name, ring, height_m) for name, height_m, ring in areas]
    # A box at the fence must not reach out of it by rounding.
    inside = tuple(
        Box(
            _snapped(box.low_x_m, width_m), _snapped(box.low_y_m, depth_m),
            _snapped(box.high_x_m, width_m), _snapped(box.high_y_m, depth_m), box.height_m,
        )
        for box in boxes
    )  # fmt: skip
    return Workspace(width_m, depth_m, inside, site.robots)


def _snapped(at_m: float, far_m: float) -> float:
    """Return where the fence begins or ends along an axis if that is `OFF_M` from a coordinate, or else the latter."""
    return next((edge_m for edge_m in (0.0, far_m) if abs(at_m - edge_m) <= OFF_M), at_m)


def _rectangle(source: str, name: str, ring: Sequence[Point], height_m: float) -> Box:
    xs_m, ys_m = [x_m for x_m, _ in ring], [y_m for _, y_m in ring]
    box = Box(min(xs_m), min(ys_m), max(xs_m), max(ys_m), height_m)
    if len(ring) != 4:
        raise _unfit(source, name, f"it has {len(ring)} corners, not 4")
    for x_m in (box.low_x_m, box.high_x_m):
        for y_m in (box.low_y_m, box.high_y_m):
            if min(math.dist(at, (x_m, y_m)) for at in ring) > OFF_M:
                raise _unfit(source, name, f"its edges are not along the axes: no corner is at ({x_m:g}, {y_m:g})")
    return box


def _unfit(source: str, name: str, why: str) -> ConfigError:
    allowed = "a fence from (0, 0) and boxes in it, with edges along the axes; other formats have other shapes"
    return ConfigError(f"{why}; allowed in .xml: {allowed}", source=source, key=name)


def _add_boxes(parent: Element, boxes: Sequence[Box]) -> None:
    for each in boxes:
        box = SubElement(parent, "box")
        SubElement(box, "low", _at(each.low_x_m, each.low_y_m, 0.0))
        SubElement(box, "high", _at(each.high_x_m, each.high_y_m, each.height_m))


def _at(x_m: float, y_m: float, z_m: float) -> dict[str, str]:
    return {"x": str(x_m), "y": str(y_m), "z": str(z_m)}


def _area_name(name: str, source: str) -> str:
    """Return a name that the reader does not take for the fence's."""
    if wrong := _NOT_IN_XML.search(name):
        raise ConfigError(
            f"the name has the character {shown_value(wrong.group())}, which XML cannot hold; allowed: any other name",
            source=source,
            key=shown_value(name),
        )
    return f"area {name}" if name.strip().lower().startswith(FENCE) else name


def _placemark(document: Element, name: str) -> Element:
    mark = SubElement(document, "Placemark")
    SubElement(mark, "name").text = name
    return mark


def _text(root: Element) -> bytes:
    indent(root, " ")
    data: bytes = tostring(root, encoding="utf-8", xml_declaration=True)
    return data + b"\n"
