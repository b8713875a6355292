"""Reads a site from GeoJSON (RFC 7946), whose features have the property `soter`."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, Final

from soter.errors import ConfigError, nearest
from soter.geometry.draft import MAX_COORDINATE_M, Draft, Outline, Spot, circle
from soter.geometry.earth import Projection, check_degrees, is_number, middle_of
from soter.geometry.site import GeoOrigin
from soter.geometry.workspace import HEIGHT_M
from soter.geometry.workspace_xml import STATION_SIDE_M
from soter.problems import cut, shown_value

ROLE: Final = "soter"
ROLES: Final = ("fence", "keep_out", "station", "start")
_MOST_DIGITS: Final = 18
_DEEP: Final = {"Point": 0, "Polygon": 2, "MultiPolygon": 3}


def read(data: bytes, source: str) -> Draft:
    """Return the draft in a GeoJSON file.

    Every feature has a property `soter`: `fence`, `keep_out`, `station` or `start`. The origin is the member `origin`
    of the collection, longitude and latitude, or else the middle of all places.

    Raises:
        ConfigError: the file is no GeoJSON in WGS 84.
    """
    collection = json_object(data, source)
    if collection.get("type") != "FeatureCollection" or not isinstance(collection.get("features"), list):
        kind = shown_value(collection.get("type"))
        raise ConfigError(f"its type is {kind}, allowed: a FeatureCollection with features", source=source)
    if (
        "crs" in collection
        and "CRS84" not in json.dumps(collection["crs"])
        and "4326" not in json.dumps(collection["crs"])
    ):
        raise ConfigError(
            f"its coordinates are in {shown_value(json.dumps(collection['crs']))}; convert it, allowed: WGS 84",
            source=source,
            key="crs",
        )
    draft = Draft(source)
    features = [each for each in enumerate(collection["features"], start=1) if _looks_right(draft, *each)]
    places = [place for number, each in features for place in _places(draft, _name(number, each), each["geometry"])]
    origin = _origin(draft, collection.get("origin")) or (middle_of(places) if places else None)
    if draft.problems or origin is None:
        return draft
    draft.origin = origin
    project = Projection(origin, source)
    for number, each in features:
        _add(draft, _name(number, each), each, lambda lon, lat: project.point(lat, lon))
    return draft


def json_object(data: bytes, source: str) -> dict[str, Any]:
    """Return the JSON object in a file.

    NaN and Infinity, which JSON does not have, are read all the same: who uses them knows of which feature they are.

    Raises:
        ConfigError: the file holds no JSON object, or one with a key twice.
    """

    def whole(number: str) -> int:
        if len(number) > _MOST_DIGITS:
            raise ValueError(f"{cut(number)} has {len(number)} digits, allowed: {_MOST_DIGITS}")
        return int(number)

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        made = dict(pairs)
        if len(made) < len(pairs):
            # Its readers take the first one, or the last.
            key, times = Counter(key for key, _ in pairs).most_common(1)[0]
            raise ConfigError(f"an object has its key {shown_value(key)} {times} times, allowed: once", source=source)
        return made

    try:
        found = json.loads(data.decode("utf-8-sig"), parse_int=whole, object_pairs_hook=once)
    except UnicodeDecodeError as failure:
        raise ConfigError(f"not UTF-8, as JSON must be: {failure.reason}", source=source) from failure
    except json.JSONDecodeError as failure:
        raise ConfigError(f"not valid JSON: {failure.msg}", source=source, line=failure.lineno) from failure
    except (ValueError, RecursionError) as failure:
        raise ConfigError(f"not valid JSON: {failure}", source=source) from failure
    if not isinstance(found, dict):
        raise ConfigError(f"it is {shown_value(found)}, allowed: an object", source=source)
    return found


def _name(number: int, feature: dict[str, Any]) -> str:
    name = (feature.get("properties") or {}).get("name")
    return str(name) if name else f"feature {number}"


def _looks_right(draft: Draft, number: int, feature: Any) -> bool:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict):
        draft.note(f"feature {number}", "it has no geometry")
        return False
    properties = feature.get("properties")
    if not isinstance(properties, dict):
        draft.note(f"feature {number}", f"it has no properties, allowed: {ROLE} = one of {', '.join(ROLES)}")
        return False
    name, role = _name(number, feature), properties.get(ROLE)
    # JSON can write half of a character, which no file can hold.
    if half := re.search("[\ud800-\udfff]", name):
        draft.note(
            f"feature {number}",
            f"its name has {shown_value(half[0])}, which is half of a character; allowed: whole ones",
        )
        return False
    if role not in ROLES:
        close = nearest(role, list(ROLES)) if isinstance(role, str) else ""
        draft.note(name, f"its property {ROLE} is {shown_value(role)}{close}; allowed: {', '.join(ROLES)}")
        return False
    for key in ("height_m", "radius_m", "side_m", "heading_deg"):
        value, allowed = properties.get(key, 1.0), "a number" if key == "heading_deg" else "a number above 0"
        wrong = not is_number(value) or not math.isfinite(value) or (key != "heading_deg" and value <= 0.0)
        if key == "radius_m" and not wrong and value > MAX_COORDINATE_M:
            wrong, allowed = True, f"at most {MAX_COORDINATE_M:g}"
        if wrong:
            draft.note(name, f"its property {key} is {shown_value(value)}, allowed: {allowed}")
            return False
    if not isinstance(robot := properties.get("robot", 1), int) or isinstance(robot, bool):
        draft.note(name, f"its property robot is {shown_value(robot)}, allowed: a whole number")
        return False
    return True


def _positions(geometry: Any) -> Iterator[Any]:
    """Yield all positions of nested lists."""
    if isinstance(geometry, list) and geometry and not isinstance(geometry[0], list):
        yield geometry
    elif isinstance(geometry, list):
        for each in geometry:
            yield from _positions(each)


def _is_nested(coordinates: Any, deep: int) -> bool:
    """Return whether lists are nested `deep` levels around positions, which are lists of numbers."""
    if not isinstance(coordinates, list):
        return False
    if deep:
        return all(_is_nested(each, deep - 1) for each in coordinates)
    return len(coordinates) >= 2 and not any(isinstance(each, (list, dict)) for each in coordinates)


def _places(draft: Draft, name: str, geometry: dict[str, Any]) -> list[tuple[float, float]]:
    found: list[tuple[float, float]] = []
    kind = str(geometry.get("type"))
    if kind in _DEEP and not _is_nested(geometry.get("coordinates"), _DEEP[kind]):
        draft.note(name, f"its coordinates are not those of a {kind}: {shown_value(geometry.get('coordinates'))}")
        return found
    for position in _positions(geometry.get("coordinates")):
        wrong = "a position has fewer than two numbers" if len(position) < 2 else check_degrees(
            "a position", position[1], position[0]
        )  # fmt: skip
        if wrong:
            draft.note(name, wrong)
            break
        found.append((float(position[1]), float(position[0])))
    return found


def _origin(draft: Draft, given: Any) -> GeoOrigin | None:
    if given is None:
        return None
    if not isinstance(given, list) or len(given) != 2 or check_degrees("it", given[1], given[0]):
        draft.note("origin", f"it is {shown_value(given)}; allowed: longitude and latitude in degrees")
        return None
    return GeoOrigin(float(given[1]), float(given[0]))


def _add(
    draft: Draft, name: str, feature: dict[str, Any], project: Callable[[float, float], tuple[float, float]]
) -> None:
    geometry, properties = feature["geometry"], feature["properties"]
    role, kind = properties[ROLE], geometry.get("type")
    height_m = float(properties.get("height_m", HEIGHT_M))
    if kind == "Point":
        x_m, y_m = project(*geometry["coordinates"][:2])
        _add_point(draft, name, role, (x_m, y_m), properties, height_m)
        return
    if kind not in ("Polygon", "MultiPolygon") or role in ("station", "start"):
        allowed = "Point" if role in ("station", "start") else "Polygon, MultiPolygon, or Point with radius_m"
        draft.note(name, f"it is a {shown_value(kind)}, allowed for a {role}: {allowed}")
        return
    polygons = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
    if not polygons:
        draft.note(name, "it has no polygons")
    for number, rings in enumerate(polygons):
        part = name if len(polygons) == 1 else f"{name}, part {number + 1}"
        projected = [[project(*position[:2]) for position in ring] for ring in rings]
        if not projected:
            draft.note(part, "it has no corners")
        else:
            draft.add(Outline(part, projected[0], height_m), projected[1:], fence=role == "fence")


def _add_point(
    draft: Draft, name: str, role: str, at: tuple[float, float], properties: dict[str, Any], height_m: float
) -> None:
    if role in ("fence", "keep_out"):
        if "radius_m" not in properties:
            draft.note(
                name, f"it is a Point without radius_m; allowed for a {role}: a polygon, or a Point with radius_m"
            )
            return
        ring = circle(*at, float(properties["radius_m"]), around=role == "keep_out")
        (draft.fences if role == "fence" else draft.keep_outs).append(Outline(name, ring, height_m))
        return
    heading_rad = math.radians(properties.get("heading_deg", 0.0))
    side_m = float(properties.get("side_m", STATION_SIDE_M))
    spot = Spot(name, *at, properties.get("robot"), heading_rad, side_m)
    (draft.stations if role == "station" else draft.starts).append(spot)
