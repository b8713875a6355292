"""Reads a workspace from XML: first into a small tree with line numbers, then into a checked workspace."""

from __future__ import annotations

import math
import re
from pathlib import Path

from soter.errors import ConfigError, floor_m, nearest
from soter.geometry.workspace import MAX_ROBOT_ID, Box, RobotPlace, Workspace
from soter.geometry.xml_tree import Element, parse_tree
from soter.problems import MAX_FILE_BYTES, Problem, config_error, cut, read_limited, shown_value

BODY_RADIUS_M = 0.105
"""Radius of the body that has to fit at starts and chargers: a TurtleBot3 Burger."""

SLACK_M = 0.05
"""Extra clearance of starts and chargers: at the very edge of phi_safer, every wobble would disengage a robot."""

MAX_SIZE_M = 10_000.0

MIN_STATION_M = 0.1
"""Least side: a robot comes to rest within some centimetres of the middle, and charges only on the station."""

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
    if len(data) > MAX_FILE_BYTES:
        raise ConfigError(f"the workspace is longer than {MAX_FILE_BYTES} bytes", source=source)
    root = parse_tree(data, source, _ROOT)
    reader = _Reader(root, phi_safer_m, spacing_m, body_radius_m)
    workspace = reader.read()
    if workspace is None:
        raise config_error(reader.problems, source)
    return workspace


class _Reader:
    """Walks the tree and notes every problem; elements with problems are left out of further checks."""

    def __init__(self, root: Element, phi_safer_m: float, spacing_m: float, body_radius_m: float) -> None:
        self.root = root
        self.problems: list[Problem] = []
        self.needed_m = phi_safer_m + SLACK_M
        self.spacing_m = spacing_m
        self.radius_m = body_radius_m

    def read(self) -> Workspace | None:
        if self.root.tag != _ROOT:
            self._note(self.root, f"<{cut(self.root.tag)}>", f"the outermost element must be <{_ROOT}>")
            return None
        self._check_names(self.root)
        if self.problems:
            return None
        dimension = self._the("dimension")
        robots, chargers = self._the("robots"), self._the("charging_stations")
        obstacles = self._the("obstacles", needed=False)
        size = self._size(dimension)
        if size is None or robots is None or chargers is None:
            return None
        boxes = self._boxes(obstacles, "obstacle", size, flat=False)
        patches = self._boxes(chargers, "charging station", size, flat=True)
        starts = self._starts(robots, size)
        if self.problems:
            return None
        if len(patches) < len(starts):
            self._note(
                chargers,
                "charging_stations",
                f"{len(patches)} charging stations for {len(starts)} robots; each robot needs one, in the order of "
                "the robots",
            )
            return None
        places = tuple(
            RobotPlace(robot_id, x_m, y_m, patch, heading_rad)
            for (_, robot_id, x_m, y_m, heading_rad), (_, patch) in zip(starts, patches, strict=False)
        )
        workspace = Workspace(size[0], size[1], tuple(box for _, box in boxes), places)
        at_starts = [
            (e, f"start of robot {place.id}", place.x_m, place.y_m)
            for (e, *_), place in zip(starts, places, strict=True)
        ]
        at_chargers = [
            (e, f"charging station of robot {place.id}", *place.charger.centre)
            for (e, _), place in zip(patches, places, strict=False)
        ]
        for spots in (at_starts, at_chargers):
            self._check_clearance(workspace, spots)
            self._check_spacing(spots)
        return None if self.problems else workspace

    def _note(self, element: Element, key: str, message: str) -> None:
        self.problems.append(Problem(message, key, element.line))

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
        if size is not None and min(size) <= 0.0:
            name = "xyz"[size.index(min(size))]
            self._note(element, "<dimension>", f"{name} is {min(size):g}, allowed: above 0")
            return None
        return size

    def _boxes(
        self, parent: Element | None, what: str, size: tuple[float, float, float], *, flat: bool
    ) -> list[tuple[Element, Box]]:
        boxes: list[tuple[Element, Box]] = []
        if parent is None:
            return boxes
        if len(parent.children) > _MAX_BOXES:
            self._note(parent, f"<{parent.tag}>", f"{len(parent.children)} boxes, allowed: at most {_MAX_BOXES}")
            return boxes
        for number, element in enumerate(parent.children, start=1):
            key = f"{what} {number}"
            low, high = self._point(element.all("low")[0], key), self._point(element.all("high")[0], key)
            if low is None or high is None:
                continue
            wrong = self._wrong_with_box(low, high, size, flat=flat)
            if wrong:
                self._note(element, key, wrong)
            else:
                boxes.append((element, Box(low[0], low[1], high[0], high[1], high[2])))
        return boxes

    @staticmethod
    def _wrong_with_box(
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        size: tuple[float, float, float],
        *,
        flat: bool,
    ) -> str:
        """Return what is wrong with a box; empty if nothing is. A flat one may have no height."""
        for axis, name in enumerate("xyz"):
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

    def _starts(
        self, parent: Element, size: tuple[float, float, float]
    ) -> list[tuple[Element, int, float, float, float]]:
        starts: list[tuple[Element, int, float, float, float]] = []
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
            starts.append((start, robot_id, point[0], point[1], math.remainder(heading_rad, math.tau)))
        return starts

    def _check_clearance(self, workspace: Workspace, spots: list[tuple[Element, str, float, float]]) -> None:
        for element, key, x_m, y_m in spots:
            clearance_m = workspace.clearance_m(x_m, y_m, self.radius_m)
            # An exact 0.15 m must pass, although it is inexact in binary.
            if clearance_m >= self.needed_m - 1e-9:
                continue
            if clearance_m < -self.radius_m:
                wrong = "it lies in a box"
            elif clearance_m < 0.0:
                wrong = f"the body (radius {self.radius_m:g} m) would overlap a box by {-clearance_m:.3f} m"
            else:
                wrong = f"the body (radius {self.radius_m:g} m) would be only {floor_m(clearance_m)} m from a box"
            self._note(
                element,
                key,
                f"{wrong}, at {_shown((x_m, y_m))}; allowed: at least {self.needed_m:g} m; "
                f"{self._nearest_pose(workspace, x_m, y_m)}",
            )

    def _nearest_pose(self, workspace: Workspace, x_m: float, y_m: float) -> str:
        """Return the nearest pose that would do, rounded such that the rounded pose still would."""
        needed_m = self.needed_m + self.radius_m
        # A centimetre grid moves the point by at most 7.1 mm.
        found = workspace.nearest_free(x_m, y_m, needed_m + 0.0075)
        if found is not None:
            rounded = round(found[0], 2), round(found[1], 2)
            if workspace.nearest_free(*rounded, needed_m) == rounded:
                return f"the nearest free pose is {_shown(rounded)}"
        found = workspace.nearest_free(x_m, y_m, needed_m)
        return "there is no free pose" if found is None else f"the nearest free pose is {_shown(found)}"

    def _check_spacing(self, spots: list[tuple[Element, str, float, float]]) -> None:
        for index, (element, key, x_m, y_m) in enumerate(spots):
            for _, other, other_x_m, other_y_m in spots[:index]:
                apart_m = math.hypot(x_m - other_x_m, y_m - other_y_m)
                if apart_m < self.spacing_m - 1e-9:
                    self._note(
                        element,
                        key,
                        f"it is {floor_m(apart_m)} m from the {other}, allowed: at least "
                        f"{self.spacing_m:g} m between the centres",
                    )


def _shown(point: tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in point)})"
