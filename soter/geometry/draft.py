"""Drafts of workspaces, as files of any format describe them, and the sites made of them, checked by feature."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

from soter.errors import ConfigError, floor_m
from soter.geometry.grid import GridMap
from soter.geometry.site import Area, GeoOrigin, Site, SitePlan
from soter.geometry.workspace import HEIGHT_M, MAX_ROBOT_ID, Point, Ring, RobotPlace, as_box
from soter.geometry.workspace_xml import BODY_RADIUS_M, MIN_STATION_M, SLACK_M, STATION_SIDE_M
from soter.problems import Problem, config_error, cut

MAX_COORDINATE_M: Final = 20_000.0
MAX_CORNERS: Final = 20_000
"""Most corners of all features together: more take minutes to prepare."""

SAGITTA_M: Final = 0.01
"""Largest error of the polygon that replaces a circle; it lies outside for a keep-out, inside for a fence."""

_MANY_CORNERS: Final = 100
"""A fence with more corners than this may be replaced, where it is far away, by a simpler one."""

_LEAST_CORNERS: Final = 12
_MOST_CORNERS: Final = 720
_LEAST_M2: Final = 1e-4
_SAME_M: Final = 1e-6
_SPIKE_RAD: Final = math.radians(0.5)
_ROUNDING_M: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Outline:
    """A polygon as given in a file.

    Attributes:
        name: its name in messages, such as `keep_out 3 (pond)`.
        ring: its corners in metres, in either sense; the first may be repeated at the end.
        height_m: height above the ground.
        line: its line in the file, if known.
    """

    name: str
    ring: Sequence[Point]
    height_m: float = HEIGHT_M
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Spot:
    """A station or a start as given in a file.

    Attributes:
        name: its name in messages.
        x_m: east.
        y_m: north.
        robot_id: its robot, if the file says so.
        heading_rad: heading of a start.
        side_m: side of a station, which is square.
        line: its line in the file, if known.
        source: where it was given, if not in the file of the workspace.
    """

    name: str
    x_m: float
    y_m: float
    robot_id: int | None = None
    heading_rad: float = 0.0
    side_m: float = STATION_SIDE_M
    line: int | None = None
    source: str | None = None


@dataclass(slots=True)
class Draft:
    """A workspace as given in a file, in metres.

    Attributes:
        source: the file, for messages.
        fences: outer boundaries; a site has one, or none.
        keep_outs: areas that robots keep out of.
        stations: where robots charge.
        starts: where robots start; without any they start on their stations.
        origin: the geographic position of the point (0, 0), if the file has geographic positions.
        map: a map of what robots keep out of, instead of areas.
        problems: the problems found so far.
    """

    source: str
    fences: list[Outline] = field(default_factory=list)
    keep_outs: list[Outline] = field(default_factory=list)
    stations: list[Spot] = field(default_factory=list)
    starts: list[Spot] = field(default_factory=list)
    origin: GeoOrigin | None = None
    map: GridMap | None = None
    problems: list[Problem] = field(default_factory=list)

    def note(self, name: str, message: str, line: int | None = None, source: str | None = None) -> None:
        """Note a problem of a feature; `source` is where it was given, if not in this file."""
        self.problems.append(Problem(message, cut(name), line, source))

    def add(self, outline: Outline, holes: Sequence[Sequence[Point]], *, fence: bool) -> None:
        """Add an outer boundary, whose holes become keep-outs, or a keep-out, which must not have any."""
        if fence:
            self.fences.append(outline)
            named = enumerate(holes, start=1)
            self.keep_outs += [Outline(f"{outline.name}, hole {n}", hole, outline.height_m) for n, hole in named]
        elif holes:
            self.note(outline.name, "it has a hole, which robots could not get into; allowed: no holes in a keep-out")
        else:
            self.keep_outs.append(outline)


def circle(x_m: float, y_m: float, radius_m: float, *, around: bool) -> Ring:
    """Return a polygon around a circle, or inside it.

    Its error is at most `SAGITTA_M`, or, for very large and very small radii, as little as the number of corners
    allows; always to the safe side.

    Args:
        x_m: the middle, east.
        y_m: the middle, north.
        radius_m: the radius.
        around: whether the polygon contains the circle; else the circle contains the polygon.
    """
    wanted = math.pi / math.acos(max(1.0 - SAGITTA_M / radius_m, 0.0)) if radius_m > SAGITTA_M else 0.0
    corners = min(max(math.ceil(wanted), _LEAST_CORNERS), _MOST_CORNERS)
    far_m = radius_m / math.cos(math.pi / corners) if around else radius_m
    angles = [math.tau * (each + 0.5) / corners for each in range(corners)]
    return tuple((x_m + far_m * math.cos(angle), y_m + far_m * math.sin(angle)) for angle in angles)


def site_of(
    draft: Draft,
    *,
    phi_safer_m: float,
    spacing_m: float,
    body_radius_m: float = BODY_RADIUS_M,
    inhabited: bool = True,
) -> Site:
    """Return the site that a draft describes.

    Args:
        draft: the draft.
        phi_safer_m: body clearance from which the obstacle module gives a robot to its AC; starts and stations must
            have more.
        spacing_m: the least distance between the centres of two starts, and of two stations.
        body_radius_m: radius of the smallest robot's body.
        inhabited: whether there must be a station.

    Raises:
        ConfigError: something in it is not allowed; all problems are listed, by feature.
    """
    _check_size(draft)
    if len(draft.fences) > 1:
        names = ", ".join(cut(each.name) for each in draft.fences[:5])
        draft.note("fence", f"there are {len(draft.fences)} outer boundaries ({names}), allowed: one; merge them")
    _stop(draft)
    # Imported here: only polygons need the library.
    try:
        from soter.geometry import decompose
    except ImportError as failure:
        raise ConfigError(
            f"polygons need shapely, which cannot be imported ({failure}); install it with pip install shapely",
            source=draft.source,
        ) from failure
    fence_ring = _ring(draft, draft.fences[0]) if draft.fences else None
    areas = [(each, ring) for each in draft.keep_outs if (ring := _ring(draft, each)) is not None]
    _stop(draft)
    fence = None if fence_ring is None else decompose.anticlockwise(fence_ring)
    _check_inside(draft, fence, areas)
    robots = _robots(draft, inhabited=inhabited)
    _stop(draft)
    plan = SitePlan(
        fence,
        () if fence is None else decompose.pieces_around(fence),
        tuple(
            Area(each.name, turned, decompose.pieces_of(turned), each.height_m)
            for each, ring in areas
            for turned in [decompose.anticlockwise(ring)]
        ),
        robots,
        draft.origin,
        draft.map,
    )
    site = Site(plan)
    if fence is not None and len(fence) > _MANY_CORNERS:
        simpler = decompose.simpler_around(fence, site.unders_m)
        site = Site(replace(plan, far_around=simpler))
    _check_places(draft, site, phi_safer_m, spacing_m, body_radius_m)
    _stop(draft)
    return site


def _stop(draft: Draft) -> None:
    if draft.problems:
        elsewhere = {each.source for each in draft.problems}
        raise config_error(draft.problems, elsewhere.pop() or draft.source if len(elsewhere) == 1 else draft.source)


def _check_size(draft: Draft) -> None:
    corners = sum(len(each.ring) for each in (*draft.fences, *draft.keep_outs))
    if corners > MAX_CORNERS:
        most = max((*draft.fences, *draft.keep_outs), key=lambda each: len(each.ring))
        draft.note(
            most.name,
            f"all polygons have {corners} corners, this one {len(most.ring)}; allowed: at most {MAX_CORNERS}; "
            "simplify them",
            most.line,
        )
    # Features that could not be read may have been any of these.
    if not (draft.problems or draft.fences or draft.keep_outs or draft.stations):
        draft.note("file", "there is neither a boundary nor anything to keep out of, nor a station in it")


def _ring(draft: Draft, outline: Outline) -> Ring | None:
    """Return the corners of a polygon, each once; note a problem and return None if it is no polygon."""
    import shapely  # type: ignore[import-untyped]

    name, line = outline.name, outline.line
    corners = [(float(x), float(y)) for x, y in outline.ring]
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in corners):
        draft.note(name, "a coordinate is not a finite number", line)
        return None
    far = next((at for at in corners if max(map(abs, at)) > MAX_COORDINATE_M), None)
    if far is not None:
        draft.note(name, f"({far[0]:g}, {far[1]:g}) is too far away, allowed: at most {MAX_COORDINATE_M:g} m", line)
        return None
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    if len(corners) < 3:
        draft.note(name, f"it has {len(corners)} corners, allowed: at least 3", line)
        return None
    same = next((a for a, b in pairwise([*corners, corners[0]]) if math.dist(a, b) < _SAME_M), None)
    if same is not None:
        draft.note(name, f"the corner ({same[0]:g}, {same[1]:g}) occurs twice in a row", line)
        return None
    polygon = shapely.Polygon(corners)
    if (spike := _spike(corners)) is not None:
        draft.note(name, f"it has a spike at ({spike[0]:g}, {spike[1]:g}): its edges go there and back", line)
        return None
    if not polygon.is_valid:
        # "Self-intersection[1 2]", with the place in brackets.
        reason = shapely.is_valid_reason(polygon)
        draft.note(name, f"it crosses or touches itself: {reason}", line)
        return None
    if polygon.area < _LEAST_M2:
        draft.note(name, f"its area is {polygon.area:.3g} m2, allowed: at least {_LEAST_M2:g} m2", line)
        return None
    return tuple(corners)


def _spike(corners: Sequence[Point]) -> Point | None:
    around = [corners[-1], *corners, corners[0]]
    for (ax, ay), (bx, by), (cx, cy) in zip(around, around[1:], around[2:], strict=False):
        angle = math.atan2((cx - bx) * (ay - by) - (cy - by) * (ax - bx), (cx - bx) * (ax - bx) + (cy - by) * (ay - by))
        if abs(angle) < _SPIKE_RAD:
            return bx, by
    return None


def _check_inside(draft: Draft, fence: Ring | None, areas: Iterable[tuple[Outline, Ring]]) -> None:
    """Note areas entirely outside the fence, which are most likely misplaced."""
    if fence is None:
        return
    import shapely

    inside = shapely.Polygon(fence)
    for outline, ring in areas:
        if not inside.intersects(shapely.Polygon(ring)):
            away_m = inside.distance(shapely.Polygon(ring))
            draft.note(outline.name, f"it lies outside of the fence, {away_m:.3g} m away from it", outline.line)


def _robots(draft: Draft, *, inhabited: bool) -> tuple[RobotPlace, ...]:
    stations, starts = draft.stations, draft.starts
    for spot in (*stations, *starts):
        if not (math.isfinite(spot.x_m) and math.isfinite(spot.y_m)):
            draft.note(spot.name, "a coordinate is not a finite number", spot.line, spot.source)
        elif max(abs(spot.x_m), abs(spot.y_m)) > MAX_COORDINATE_M:
            draft.note(
                spot.name,
                f"({spot.x_m:g}, {spot.y_m:g}) is too far away, allowed: at most {MAX_COORDINATE_M:g} m",
                spot.line,
                spot.source,
            )
        if not MIN_STATION_M <= spot.side_m <= MAX_COORDINATE_M:
            allowed = (
                f"at least {MIN_STATION_M:g} m" if spot.side_m < MIN_STATION_M else f"at most {MAX_COORDINATE_M:g} m"
            )
            draft.note(spot.name, f"it is {spot.side_m:g} m wide, allowed: {allowed}", spot.line, spot.source)
    if not stations and inhabited:
        draft.note(
            "stations",
            "there is no station in it, and every robot needs one to charge on; a mission may give them, [[station]]",
        )
    elif len(starts) > len(stations):
        draft.note(
            "stations",
            f"{len(stations)} stations for {len(starts)} robots; each robot needs one, in the order of the robots",
        )
    ids = [
        number if spot.robot_id is None else spot.robot_id for number, spot in enumerate(starts or stations, start=1)
    ]
    for robot_id in ids:
        if not 1 <= robot_id <= MAX_ROBOT_ID:
            draft.note("robots", f"id is {robot_id}, allowed: a whole number from 1 to {MAX_ROBOT_ID}")
    if len(set(ids)) < len(ids):
        draft.note("robots", f"the ids are {', '.join(map(str, ids))}; each robot needs its own")
    if draft.problems:
        return ()
    return tuple(
        RobotPlace(
            robot_id, start.x_m, start.y_m, as_box(station.x_m, station.y_m, station.side_m),
            math.remainder(start.heading_rad, math.tau),
        )
        for robot_id, start, station in zip(ids, starts or stations, stations, strict=False)
    )  # fmt: skip


def _check_places(draft: Draft, site: Site, phi_safer_m: float, spacing_m: float, body_radius_m: float) -> None:
    needed_m = phi_safer_m + SLACK_M
    starts = [(f"start of robot {place.id}", (place.x_m, place.y_m)) for place in site.robots]
    stations = [(f"charging station of robot {place.id}", place.charger.centre) for place in site.robots]
    for spots, given in ((starts, draft.starts or draft.stations), (stations, draft.stations)):
        for index, (name, at) in enumerate(spots):
            line, source = given[index].line, given[index].source
            if not site.contains(*at):
                draft.note(
                    name, f"({at[0]:g}, {at[1]:g}) lies {-site.fence_m(*at):.3f} m outside of the fence", line, source
                )
                continue
            clearance_m = site.clearance_m(*at, body_radius_m)
            if clearance_m < needed_m - _ROUNDING_M:
                found = _free_near(site, at, needed_m + body_radius_m)
                where = (
                    "there is no free place" if found is None else f"a free place is ({found[0]:.2f}, {found[1]:.2f})"
                )
                draft.note(
                    name,
                    f"the body (radius {body_radius_m:g} m) at ({at[0]:g}, {at[1]:g}) is {floor_m(clearance_m)} m from "
                    f"'{cut(_nearest_area(site, at))}'; allowed: at least {needed_m:g} m; {where}",
                    line,
                    source,
                )
            for other, there in spots[:index]:
                if (apart_m := math.dist(at, there)) < spacing_m - _ROUNDING_M:
                    draft.note(
                        name,
                        f"it is {floor_m(apart_m)} m from the {other}, allowed: at least "
                        f"{spacing_m:g} m between centres",
                        line,
                        source,
                    )


def _free_near(site: Site, at: Point, away_m: float) -> Point | None:
    from soter.geometry import decompose

    if site.field is not None:
        return site.field.nearest_free(*at, away_m)
    return decompose.free_near(site.plan.fence, [area.ring for area in site.plan.areas], at, away_m)


def _nearest_area(site: Site, at: Point) -> str:
    from soter.geometry.convex import Pieces

    if site.plan.map is not None:
        return "what is occupied in the map"
    return min(site.plan.areas, key=lambda area: Pieces(area.pieces).distance_m(*at)).name
