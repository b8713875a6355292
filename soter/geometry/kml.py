"""Reads a site from KML: the polygons and points of its placemarks, by their names."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot
from soter.geometry.earth import Projection, check_degrees, middle_of
from soter.problems import shown_value

FENCE: Final = "fence"
"""Prefix of the name of the placemark whose polygon is the outer boundary."""

_PLACES: Final = ("coordinates", "coord", "Location")
"""What has the places of shapes, of tracks and of models."""


def read(data: bytes, source: str) -> Draft:
    """Return the draft in a KML file.

    The polygon of the placemark whose name begins with `fence` is the boundary, other polygons are keep-outs, and
    points are stations. Other shapes are refused. Heights are not read. The origin is the middle of all places.

    Raises:
        ConfigError: the file is no KML.
    """
    try:
        root = fromstring(data, forbid_dtd=True)
    except ParseError as failure:
        line = failure.position[0]
        raise ConfigError(f"not well-formed XML: {failure}", source=source, line=line) from failure
    except DefusedXmlException as failure:
        raise ConfigError(
            "a document type or an entity is declared, which is refused for safety; remove it", source=source
        ) from failure
    except (ValueError, LookupError) as failure:
        raise ConfigError(f"cannot be decoded: {failure}; write it in UTF-8", source=source) from failure
    if _tag(root) != "kml":
        raise ConfigError(f"its outermost element is {shown_value(_tag(root))}, allowed: <kml>", source=source)
    draft = Draft(source)
    rings: list[tuple[str, list[tuple[float, float]], list[list[tuple[float, float]]]]] = []
    points: list[tuple[str, tuple[float, float]]] = []
    for number, mark in enumerate((each for each in root.iter() if _tag(each) == "Placemark"), start=1):
        name = next((each.text for each in mark if _tag(each) == "name"), None) or f"Placemark {number}"
        name = name.strip()
        taken: set[Element] = set()
        for shape in mark.iter():
            if _tag(shape) == "Polygon":
                outer = [_corners(draft, name, each, taken) for each in shape if _tag(each) == "outerBoundaryIs"]
                # Some programs write all holes into one element.
                inner = [ring for each in shape if _tag(each) == "innerBoundaryIs" for ring in each]
                holes = [_corners(draft, name, each, taken) for each in inner]
                if len(outer) != 1:
                    draft.note(name, f"its polygon has {len(outer)} outer boundaries, allowed: one")
                else:
                    rings.append((name, outer[0], holes))
            elif _tag(shape) == "Point":
                found = _corners(draft, name, shape, taken)
                if len(found) != 1:
                    draft.note(name, f"its point has {len(found)} places, allowed: one")
                else:
                    points.append((name, found[0]))
        if (other := _other_shape(mark, taken)) is not None:
            draft.note(name, f"it has places in a <{other}>, allowed: in the boundaries of a Polygon, and in a Point")
    places = [at for _, ring, _ in rings for at in ring] + [at for _, at in points]
    if draft.problems or not places:
        return draft
    if rings and not any(_is_fence(name) for name, _, _ in rings):
        names = ", ".join(shown_value(name) for name, _, _ in rings[:5])
        draft.note(
            "Placemark", f"none with a polygon has a name that begins with '{FENCE}' ({names}); name the boundary so"
        )
        return draft
    draft.origin = middle_of(places)
    project = Projection(draft.origin, source).point
    for name, ring, holes in rings:
        edge, *gaps = ([project(*at) for at in each] for each in (ring, *holes))
        draft.add(Outline(name, edge), gaps, fence=_is_fence(name))
    draft.stations += [Spot(name, *project(*at)) for name, at in points]
    return draft


def _is_fence(name: str) -> bool:
    return name.lower().startswith(FENCE)


def _tag(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _other_shape(mark: Element, taken: Collection[Element]) -> str | None:
    """Return the tag of what has places that were not read, such as a line: robots would not keep out of it."""
    for shape in mark.iter():
        if any(_tag(each) in _PLACES and each not in taken for each in shape):
            return _tag(shape)
    return None


def _corners(draft: Draft, name: str, element: Element, taken: set[Element]) -> list[tuple[float, float]]:
    """Return latitudes and longitudes, and add what holds them to `taken`.

    KML has longitude, latitude and maybe a height.
    """
    lists = [each for each in element.iter() if _tag(each) == "coordinates"]
    taken.update(lists)
    if len(lists) > 1:
        draft.note(name, f"a <{_tag(element)}> has {len(lists)} lists of coordinates, allowed: one")
        return []
    # The text behind an element is not its parent's.
    if inside := [each for coordinates in lists for each in coordinates]:
        draft.note(name, f"there is a <{_tag(inside[0])}> among its coordinates, allowed: text")
        return []
    text = "".join(each.text or "" for each in lists)
    found: list[tuple[float, float]] = []
    for word in text.split():
        try:
            lon, lat = (float(part) for part in word.split(",")[:2])
        except ValueError:
            draft.note(name, f"{shown_value(word)} are no coordinates; allowed: longitude,latitude in degrees")
            return []
        if wrong := check_degrees("it", lat, lon):
            draft.note(name, wrong)
            return []
        found.append((lat, lon))
    return found
