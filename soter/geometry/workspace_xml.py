"""Reads a workspace from XML: first into a small tree with line numbers, then into a checked workspace."""

from __future__ import annotations

import math
import re
from pathlib import Path

from soter.errors import ConfigError, floor_m, nearest
from soter.geometry.room import Room, RoomBox, RoomStart
from soter.geometry.workspace import HEIGHT_M, MAX_ROBOT_ID, Box, RobotPlace, Workspace, as_box
from soter.geometry.xml_tree import Element, parse_tree
from soter.problems import MAX_FILE_BYTES, Problem, config_error, cut, read_limited, shown_value

BODY_RADIUS_M = 0.105
"""Radius of the body that has to fit at starts and chargers: a TurtleBot3 Burger."""

SLACK_M = 0.05
"""Extra clearance of starts and chargers: at the very edge of phi_safer, every wobble would disengage a robot."""

MAX_SIZE_M = 10_000.0

MIN_STATION_M = 0.1
"""Least side: a robot comes to rest within some centimetres of the middle, and charges only on the station."""

STATION_SIDE_M = 0.5
"""Side of a station that is given by its middle alone."""

_MAX_BOXES = 250  # naming the nearest free pose costs up to the cube of this
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_ID = re.compile(r"\s*[1-9]\d{0,2}\s*", re.ASCII)

# By element: (its attributes, optional ones among them, its children).
_GRAMMAR: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {
    "configuration": ((), (), ("dimension", "robots", "obstacles", "charging_stations")),
    "dimension": (("x", "y", "z"), (), ()),
    "robots": ((), (), ("robot",)),
    "robot": (("id",), (), ("start",)),
    "start": (("x", "y", "z", "heading"), ("z", "heading"), ()),
    "obstacles": ((), (), ("box",)),
    "charging_stations": ((), (), ("box",)),
    "box": ((), (), ("low", "high")),
    "low": (("x", "y", "z"), (), ()),
    "high": (("x", "y", "z"), (), ()),
}
_ROOT = "configuration"

_Spot = tuple[RoomStart | RoomBox, str, float, float]
"""What has a line, its name in messages, and its middle, x and y."""


def read_workspace(
    path: Path, *, phi_safer_m: float = 0.1, spacing_m: float = 0.5, body_radius_m: float = BODY_RADIUS_M
) -> Workspace:
    """Read a workspace file.

    Args:
        path: the XML file.
        phi_safer_m: body clearance from which the obstacle module gives a robot to its AC; starts and chargers must
            have `SLACK_M` more.
        spacing_m: the least distance between the centres of two starts, and of two chargers.
        body_radius_m: radius of the smallest robot's body.

    Raises:
        ConfigError: the file cannot be read or something in it is not allowed; all problems are listed, each with its
            line.
    """
    data = read_limited(path, "workspace file")
    return parse_workspace(data, str(path), phi_safer_m=phi_safer_m, spacing_m=spacing_m, body_radius_m=body_radius_m)


def parse_workspace(
    data: bytes,
    source: str,
    *,
    phi_safer_m: float = 0.1,
    spacing_m: float = 0.5,
    body_radius_m: float = BODY_RADIUS_M,
) -> Workspace:
    """Read a workspace from the bytes of an XML file; `source` names it in errors. See `read_workspace`."""
    reader = _Reader(data, source)
    room = reader.room()
    workspace = None if room is None else reader.workspace(room, phi_safer_m, spacing_m, body_radius_m)
    if workspace is None:
        raise config_error(reader.problems, source)
    return workspace


def parse_room(data: bytes, source: str) -> Room:
    """Read what an XML file says, without comparing its parts with each other: it may lack stations.

    Raises:
        ConfigError: something in it is not allowed.
    """
    reader = _Reader(data, source)
    room = reader.room()
    if room is None:
        raise config_error(reader.problems, source)
    return room


class _Reader:
    """Walks the tree and notes every problem; elements with problems are left out of further checks."""

    def __init__(self, data: bytes, source: str) -> None:
        if len(data) > MAX_FILE_BYTES:
            raise ConfigError(f"the workspace is longer than {MAX_FILE_BYTES} bytes", source=source)
        self.root = parse_tree(data, source, _ROOT)
        self.problems: list[Problem] = []

    def room(self) -> Room | None:
        """Return what the file says; None if something in it is not allowed."""
        if self.root.tag != _ROOT:
            self._note(self.root, f"<{cut(self.root.tag)}>", f"the outermost element must be <{_ROOT}>")
            return None
        self._check_names(self.root)
        if self.problems:
            return None
        dimension = self._the("dimension")
        robots, chargers = self._the("robots"), self._the("charging_stations", needed=False)
        obstacles = self._the("obstacles", needed=False)
        size = self._size(dimension)
        if size is None or robots is None:
            return None
        boxes = self._boxes(obstacles, "obstacle", size, flat=False)
        patches = self._boxes(chargers, "charging station", size, flat=True)
        starts = self._starts(robots, size)
        return None if self.problems else Room(size[0], size[1], boxes, patches, starts)

    def workspace(self, room: Room, phi_safer_m: float, spacing_m: float, body_radius_m: float) -> Workspace | None:
        """Return the workspace; None if a robot has no station, or a place has no room around it."""
        if len(room.stations) < len(room.starts):
            missing = f"{len(room.stations)} charging stations for {len(room.starts)} robots"
            where = "" if room.stations else "; the mission file may give them, [[station]]"
            self._note(
                (self.root.all("charging_stations") or [self.root])[0],
                "charging_stations",
                f"{missing}; each robot needs one, in the order of the robots{where}",
            )
            return None
        pairs = list(zip(room.starts, room.stations, strict=False))
        places = [
            RobotPlace(start.id, start.x_m, start.y_m, station.box, start.heading_rad) for start, station in pairs
        ]
        workspace = Workspace(room.width_m, room.depth_m, tuple(each.box for each in room.obstacles), tuple(places))
        at_starts: list[_Spot] = [(start, f"start of robot {start.id}", start.x_m, start.y_m) for start, _ in pairs]
        at_stations: list[_Spot] = [
            (station, f"charging station of robot {start.id}", *station.box.centre) for start, station in pairs
        ]
        for spots in (at_starts, at_stations):
            self._check_clearance(workspace, spots, phi_safer_m + SLACK_M, body_radius_m)
            self._check_spacing(spots, spacing_m)
        return None if self.problems else workspace

    def _note(self, at: Element | RoomStart | RoomBox, key: str, message: str) -> None:
        self.problems.append(Problem(message, key, at.line))

    def _check_names(self, element: Element) -> None:
        attributes, optional, children = _GRAMMAR[element.tag]
        here = f"<{element.tag}>"
        for name in element.attributes:
            if name not in attributes:
                allowed = ", ".join(attributes) or "none"
                self._note(
                    element,
                    here,
                    f"unknown attribute {shown_value(name)}{nearest(name, list(attributes))}; allowed: {allowed}",
                )
        for name in attributes:
            if name not in element.attributes and name not in optional:
                self._note(element, here, f"attribute '{name}' is missing; it needs {', '.join(attributes)}")
        for child in element.children:
            if child.tag in children:
                self._check_names(child)
            else:
                allowed = ", ".join(f"<{name}>" for name in children) or "none"
                self._note(
                    child,
                    here,
                    f"unknown element <{cut(child.tag)}>{nearest(child.tag, list(children))}; allowed here: {allowed}",
                )
        if element.tag in ("robot", "box"):
            for name in children:
                found = element.all(name)
                if len(found) != 1:
                    self._note(element, here, f"it has {len(found)} <{name}>, allowed: exactly one")

    def _the(self, tag: str, *, needed: bool = True) -> Element | None:
        found = self.root.all(tag)
        if len(found) > 1:
            self._note(found[1], f"<{tag}>", f"it occurs {len(found)} times, allowed: once")
        elif not found and needed:
            self._note(self.root, f"<{_ROOT}>", f"<{tag}> is missing")
        return found[0] if len(found) == 1 else None

    def _number(self, element: Element, key: str, name: str) -> float | None:
        text = element.attributes.get(name, "0")
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not -MAX_SIZE_M <= value <= MAX_SIZE_M:
            self._note(
                element,
                key,
                f"{name} is {shown_value(text)}, allowed: a finite decimal number, at most +-{MAX_SIZE_M:g}",
            )
            return None
        return value

    def _point(self, element: Element, key: str) -> tuple[float, float, float] | None:
        x, y, z = (self._number(element, key, name) for name in ("x", "y", "z"))
        return None if x is None or y is None or z is None else (x, y, z)

    def _size(self, element: Element | None) -> tuple[float, float, float] | None:
        if element is None:
            return None
        size = self._point(element, "<dimension>")
        if size is None:
            return None
        for name, value in zip("xyz", size, strict=True):
            if value < 0.0 or (value == 0.0 and name != "z"):
                allowed = "at least 0" if name == "z" else "above 0"
                self._note(element, "<dimension>", f"{name} is {value:g}, allowed: {allowed}")
                return None
        # Rooms are also drawn flat, with boxes that are not.
        return size if size[2] > 0.0 else (size[0], size[1], HEIGHT_M)

    def _boxes(
        self, parent: Element | None, what: str, size: tuple[float, float, float], *, flat: bool
    ) -> tuple[RoomBox, ...]:
        boxes: list[RoomBox] = []
        if parent is None:
            return ()
        if len(parent.children) > _MAX_BOXES:
            self._note(parent, f"<{parent.tag}>", f"{len(parent.children)} boxes, allowed: at most {_MAX_BOXES}")
            return ()
        for number, element in enumerate(parent.children, start=1):
            key = f"{what} {number}"
            low, high = self._point(element.all("low")[0], key), self._point(element.all("high")[0], key)
            if low is None or high is None:
                continue
            is_point = flat and low == high
            wrong = self._wrong_with_box(low, high, size, flat=flat, is_point=is_point)
            if wrong:
                self._note(element, key, wrong)
            elif is_point:
                boxes.append(RoomBox(as_box(low[0], low[1], STATION_SIDE_M), element.line))
            else:
                boxes.append(RoomBox(Box(low[0], low[1], high[0], high[1], high[2]), element.line))
        return tuple(boxes)

    @staticmethod
    def _wrong_with_box(
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        size: tuple[float, float, float],
        *,
        flat: bool,
        is_point: bool,
    ) -> str:
        """Return what is wrong with a box; empty if nothing is. A flat one may have no height, a point has no sides."""
        for axis, name in enumerate("" if is_point else "xyz"):
            if high[axis] < low[axis] or (high[axis] == low[axis] and not (flat and name == "z")):
                return (
                    f"it is inside out: high {name} is {high[axis]:g}, allowed: above low {name}, which is "
                    f"{low[axis]:g}"
                )
            # An exact 0.1 m must pass, although it is inexact in binary.
            if flat and name != "z" and high[axis] - low[axis] < MIN_STATION_M - 1e-9:
                return (
                    f"it is {high[axis] - low[axis]:g} m wide in {name}, allowed: at least {MIN_STATION_M:g} m, or "
                    "robots would come to rest beside it"
                )
        if low[2] != 0.0:
            return f"low z is {low[2]:g}, allowed: 0, it stands on the ground"
        for axis, name in enumerate("xyz"):
            if low[axis] < 0.0 or high[axis] > size[axis]:
                return (
                    f"it lies outside the workspace: {name} from {low[axis]:g} to {high[axis]:g}, allowed: "
                    f"0 to {size[axis]:g}"
                )
        return ""

    def _starts(self, parent: Element, size: tuple[float, float, float]) -> tuple[RoomStart, ...]:
        starts: list[RoomStart] = []
        lines: dict[int, int] = {}
        if not parent.children:
            self._note(parent, "<robots>", "there is no robot, allowed: at least one <robot>")
        for element in parent.children:
            text = element.attributes["id"]
            robot_id = int(text) if _ID.fullmatch(text) else 0
            if not 1 <= robot_id <= MAX_ROBOT_ID:
                self._note(
                    element, "<robot>", f"id is {shown_value(text)}, allowed: a whole number from 1 to {MAX_ROBOT_ID}"
                )
                continue
            key = f"robot {robot_id}"
            if robot_id in lines:
                self._note(
                    element, key, f"this id is taken by the robot in line {lines[robot_id]}; each robot needs its own"
                )
                continue
            lines[robot_id] = element.line
            start = element.all("start")[0]
            point, heading_rad = self._point(start, key), self._number(start, key, "heading")
            if point is None or heading_rad is None:
                continue
            if not (0.0 <= point[0] <= size[0] and 0.0 <= point[1] <= size[1] and 0.0 <= point[2] <= size[2]):
                self._note(
                    start,
                    key,
                    f"it starts outside the workspace, at {_shown(point)}; allowed: from (0, 0, 0) to {_shown(size)}",
                )
                continue
            starts.append(RoomStart(robot_id, point[0], point[1], math.remainder(heading_rad, math.tau), start.line))
        return tuple(starts)

    def _check_clearance(self, workspace: Workspace, spots: list[_Spot], needed_m: float, radius_m: float) -> None:
        for at, key, x_m, y_m in spots:
            clearance_m = workspace.clearance_m(x_m, y_m, radius_m)
            # An exact 0.15 m must pass, although it is inexact in binary.
            if clearance_m >= needed_m - 1e-9:
                continue
            if clearance_m < -radius_m:
                wrong = "it lies in a box"
            elif clearance_m < 0.0:
                wrong = f"the body (radius {radius_m:g} m) would overlap a box by {-clearance_m:.3f} m"
            else:
                wrong = f"the body (radius {radius_m:g} m) would be only {floor_m(clearance_m)} m from a box"
            self._note(
                at,
                key,
                f"{wrong}, at {_shown((x_m, y_m))}; allowed: at least {needed_m:g} m; "
                f"{self._nearest_pose(workspace, x_m, y_m, needed_m + radius_m)}",
            )

    @staticmethod
    def _nearest_pose(workspace: Workspace, x_m: float, y_m: float, needed_m: float) -> str:
        """Return the nearest pose that would do, rounded such that the rounded pose still would."""
        # A centimetre grid moves the point by at most 7.1 mm.
        found = workspace.nearest_free(x_m, y_m, needed_m + 0.0075)
        if found is not None:
            rounded = round(found[0], 2), round(found[1], 2)
            if workspace.nearest_free(*rounded, needed_m) == rounded:
                return f"the nearest free pose is {_shown(rounded)}"
        found = workspace.nearest_free(x_m, y_m, needed_m)
        return "there is no free pose" if found is None else f"the nearest free pose is {_shown(found)}"

    def _check_spacing(self, spots: list[_Spot], spacing_m: float) -> None:
        for index, (at, key, x_m, y_m) in enumerate(spots):
            for _, other, other_x_m, other_y_m in spots[:index]:
                apart_m = math.hypot(x_m - other_x_m, y_m - other_y_m)
                if apart_m < spacing_m - 1e-9:
                    self._note(
                        at,
                        key,
                        f"it is {floor_m(apart_m)} m from the {other}, allowed: at least "
                        f"{spacing_m:g} m between the centres",
                    )


def _shown(point: tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in point)})"
