"""Reads a site from a QGroundControl plan: its geofence, and its rally points as stations."""

from __future__ import annotations

from typing import Any, Final

from soter.errors import ConfigError
from soter.geometry.draft import MAX_COORDINATE_M, Draft, Outline, Spot, circle
from soter.geometry.earth import Projection, check_degrees, is_number, middle_of
from soter.geometry.geojson import json_object
from soter.geometry.site import GeoOrigin
from soter.problems import shown_value

_VERSION: Final = 2
"""Version of a plan's geofence."""


def read(data: bytes, source: str) -> Draft:
    """Return the draft in a `.plan` file: inclusion and exclusion polygons and circles, rally points as stations.

    The origin is its planned home, or else the middle of all places. In a plan, latitude comes before longitude.

    Raises:
        ConfigError: the file is no plan.
    """
    plan = json_object(data, source)
    if plan.get("fileType") != "Plan":
        raise ConfigError(
            f"its fileType is {shown_value(plan.get('fileType'))}, allowed: 'Plan', as QGroundControl writes it",
            source=source,
        )
    draft = Draft(source)
    geofence, rally = _table(draft, plan, "geoFence"), _table(draft, plan, "rallyPoints")
    # Other versions say in other keys what is kept out of, which would be overlooked.
    version = geofence.get("version", _VERSION)
    if version != _VERSION:
        draft.note(
            "geoFence.version", f"it is {shown_value(version)}, allowed: {_VERSION}, as QGroundControl writes it"
        )
    polygons = [(f"geoFence polygon {n}", each) for n, each in enumerate(_list(draft, geofence, "polygons"), start=1)]
    circles = [(f"geoFence circle {n}", each) for n, each in enumerate(_list(draft, geofence, "circles"), start=1)]
    points = [(f"rally point {n}", each) for n, each in enumerate(_list(draft, rally, "points"), start=1)]
    places: list[tuple[float, float]] = []

    def place(name: str, given: Any) -> tuple[float, float] | None:
        wrong = "it is no place" if not isinstance(given, list) or len(given) < 2 else check_degrees("it", *given[:2])
        if wrong:
            draft.note(name, wrong)
            return None
        places.append((float(given[0]), float(given[1])))
        return places[-1]

    rings = [
        (name, each.get("inclusion"), [place(name, at) for at in _list(draft, each, "polygon", name)])
        for name, each in polygons
        if _is_table(draft, name, each)
    ]
    discs = [
        (name, each.get("inclusion"), place(name, each["circle"].get("center")), each["circle"].get("radius"))
        for name, each in circles
        if _is_table(draft, name, each) and _is_table(draft, name, each.get("circle"))
    ]
    stations = [(name, place(name, at)) for name, at in points]
    home = _table(draft, plan, "mission").get("plannedHomePosition")
    at_home = place("plannedHomePosition", home) if home is not None else None
    if draft.problems or not places:
        return draft
    origin = draft.origin = middle_of(places) if at_home is None else GeoOrigin(*at_home)
    project = Projection(origin, source).point
    for name, inclusion, ring in rings:
        outline = Outline(name, [project(*at) for at in ring if at is not None])
        _add(draft, outline, inclusion)
    for name, inclusion, middle, radius_m in discs:
        if not is_number(radius_m) or not 0.0 < radius_m <= MAX_COORDINATE_M:
            allowed = f"above 0, at most {MAX_COORDINATE_M:g}, in metres"
            draft.note(name, f"its radius is {shown_value(radius_m)}, allowed: {allowed}")
        elif middle is not None:
            _add(
                draft,
                Outline(name, circle(*project(*middle), float(radius_m), around=inclusion is not True)),
                inclusion,
            )
    draft.stations += [Spot(name, *project(*at)) for name, at in stations if at is not None]
    return draft


def _add(draft: Draft, outline: Outline, inclusion: Any) -> None:
    if not isinstance(inclusion, bool):
        draft.note(outline.name, f"inclusion is {shown_value(inclusion)}, allowed: true or false")
    else:
        (draft.fences if inclusion else draft.keep_outs).append(outline)


def _is_table(draft: Draft, name: str, given: Any) -> bool:
    if not isinstance(given, dict):
        draft.note(name, f"it is {shown_value(given)}, allowed: an object")
    return isinstance(given, dict)


def _table(draft: Draft, plan: dict[str, Any], key: str) -> dict[str, Any]:
    found = plan.get(key, {})
    return found if _is_table(draft, key, found) else {}


def _list(draft: Draft, table: dict[str, Any], key: str, of: str = "") -> list[Any]:
    """Return a list of a table, or of `of`, one of many such tables."""
    found = table.get(key, [])
    if not isinstance(found, list):
        draft.note(of or key, f"{f'its {key}' if of else 'it'} is {shown_value(found)}, allowed: a list")
        return []
    return found
