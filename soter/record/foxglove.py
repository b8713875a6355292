"""The messages that the Foxglove app draws without any extension, filled with what a run shows.

Names and fields are those of Foxglove's message schemas; fields that have their default are left out there too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Final

from msgspec import Meta, Struct

from soter.geometry.site import Site
from soter.geometry.workspace import Box, Workspace

FRAME: Final = "workspace"
"""The frame of all positions: ENU, metres."""

ROBOT_HEIGHT_M: Final = 0.19
_FLAT_M: Final = 0.004
_LINE_M: Final = 0.03

FENCE_COLOUR: Final = (0.35, 0.35, 0.40, 1.0)
BOX_COLOUR: Final = (0.45, 0.36, 0.30, 1.0)
CHARGER_COLOUR: Final = (0.95, 0.80, 0.25, 0.8)
AC_COLOUR: Final = (0.20, 0.65, 0.32, 1.0)
SC_COLOUR: Final = (0.90, 0.33, 0.20, 1.0)

_LINE_STRIP: Final = 0


class FoxgloveTime(Struct):
    """Seconds and nanoseconds."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, time_s: float) -> FoxgloveTime:
        """Return a fleet time as seconds and nanoseconds; negative times become 0."""
        return cls(*divmod(nanoseconds(time_s), 1_000_000_000))


class Duration(Struct):
    """Seconds and nanoseconds."""

    sec: int = 0
    nsec: int = 0


class FoxgloveVector3(Struct):
    """A vector, or a point."""

    x: float
    y: float
    z: float = 0.0


class FoxgloveQuaternion(Struct):
    """A rotation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0

    @classmethod
    def turned(cls, heading_rad: float) -> FoxgloveQuaternion:
        """Return a rotation about the vertical."""
        return cls(z=_seen(math.sin(heading_rad / 2.0)), w=_seen(math.cos(heading_rad / 2.0)))


class FoxglovePose(Struct):
    """Position and orientation."""

    position: FoxgloveVector3
    orientation: FoxgloveQuaternion


class Color(Struct):
    """Parts of full brightness, and opacity, from 0 to 1."""

    r: float
    g: float
    b: float
    a: float


class FrameTransform(Struct):
    """Where one frame stands in another."""

    timestamp: FoxgloveTime
    parent_frame_id: str
    child_frame_id: str
    translation: FoxgloveVector3
    rotation: FoxgloveQuaternion


class FrameTransforms(Struct):
    """Where frames stand in others."""

    transforms: list[FrameTransform]


class PosesInFrame(Struct):
    """Poses, here those that an AC means to pass."""

    timestamp: FoxgloveTime
    frame_id: str
    poses: list[FoxglovePose]


class CubePrimitive(Struct):
    """A box in a scene."""

    pose: FoxglovePose
    size: FoxgloveVector3
    color: Color


class CylinderPrimitive(Struct):
    """A cylinder in a scene."""

    pose: FoxglovePose
    size: FoxgloveVector3
    bottom_scale: float
    top_scale: float
    color: Color


class ArrowPrimitive(Struct):
    """An arrow in a scene, along its x axis."""

    pose: FoxglovePose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class LinePrimitive(Struct):
    """A line in a scene."""

    type: Annotated[int, Meta(description="0 is a line strip.")]
    pose: FoxglovePose
    thickness: float
    scale_invariant: bool
    points: list[FoxgloveVector3]
    color: Color


class SceneEntity(Struct):
    """An object in a scene; replaces an earlier one with the same id and topic."""

    timestamp: FoxgloveTime
    frame_id: str
    id: str
    lifetime: Duration
    frame_locked: bool
    arrows: list[ArrowPrimitive]
    cubes: list[CubePrimitive]
    cylinders: list[CylinderPrimitive]
    lines: list[LinePrimitive]


class SceneUpdate(Struct):
    """What is new in a scene."""

    entities: list[SceneEntity]


class Log(Struct):
    """A line of a log."""

    timestamp: FoxgloveTime
    level: Annotated[int, Meta(description="1 debug, 2 info, 3 warning, 4 error, 5 fatal.")]
    message: str
    name: str


INFO: Final = 2
WARNING: Final = 3
ERROR: Final = 4

TRANSFORMS_TOPIC: Final = "/tf"
SCENE_TOPIC: Final = "/scene"
ROBOT_TOPIC: Final = "/robots/{robot_id}/scene"
WAY_TOPIC: Final = "/robots/{robot_id}/way"
LOG_TOPIC: Final = "/log"

TOPICS: Final[dict[type[Struct], tuple[str, ...]]] = {
    FrameTransforms: (TRANSFORMS_TOPIC,),
    SceneUpdate: (SCENE_TOPIC, ROBOT_TOPIC),
    PosesInFrame: (WAY_TOPIC,),
    Log: (LOG_TOPIC,),
}
"""The topics on which each message is recorded."""


def nanoseconds(time_s: float) -> int:
    """Return a fleet time in nanoseconds; negative times become 0."""
    return max(0, round(time_s * 1e9))


def robot_frame(robot_id: int) -> str:
    """Return the name of a robot's own frame."""
    return f"robot{robot_id}"


def transform(
    time: FoxgloveTime, robot_id: int, x_m: float, y_m: float, z_m: float, heading_rad: float
) -> FrameTransform:
    """Return a robot's pose as the transform of its frame."""
    return FrameTransform(
        time,
        FRAME,
        robot_frame(robot_id),
        FoxgloveVector3(_seen(x_m), _seen(y_m), _seen(z_m)),
        FoxgloveQuaternion.turned(heading_rad),
    )


def way(time: FoxgloveTime, places: Sequence[tuple[float, float]]) -> PosesInFrame:
    """Return a way as poses, each heading for the next."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(places)] or [0.0]
    headings.append(headings[-1])
    return PosesInFrame(
        time,
        FRAME,
        [
            FoxglovePose(FoxgloveVector3(x, y), FoxgloveQuaternion.turned(heading))
            for (x, y), heading in zip(places, headings, strict=False)
        ],
    )  # fmt: skip


def workspace_scene(workspace: Workspace) -> SceneUpdate:
    """Return the fence, the boxes and the chargers as a scene."""
    fence, kept_out = workspace.outlines()
    lines = [_line(fence, 0.0, FENCE_COLOUR)] if fence else []
    cubes = [_cube(place.charger, _FLAT_M, CHARGER_COLOUR) for place in workspace.robots]
    if isinstance(workspace, Site):
        # A polygon is drawn as two lines, one around its base and one around its top.
        grid = workspace.plan.map
        heights_m = (
            [area.height_m for area in workspace.plan.areas] if grid is None else [grid.height_m] * len(kept_out)
        )
        around = zip(kept_out, heights_m, strict=True)
        lines += [_line(ring, z, BOX_COLOUR) for ring, height_m in around for z in (0.0, height_m)]
    else:
        cubes = [_cube(box, box.height_m, BOX_COLOUR) for box in workspace.boxes] + cubes
    entity = SceneEntity(
        FoxgloveTime(0, 0), FRAME, "workspace", Duration(), False, arrows=[], cubes=cubes, cylinders=[], lines=lines
    )
    return SceneUpdate([entity])


def _line(ring: Sequence[tuple[float, float]], z: float, colour: tuple[float, float, float, float]) -> LinePrimitive:
    corners = [FoxgloveVector3(x, y, z) for x, y in (*ring, ring[0])]
    return LinePrimitive(_LINE_STRIP, _at(0.0, 0.0, 0.0), _LINE_M, False, corners, Color(*colour))


def robot_scene(time: FoxgloveTime, robot_id: int, radius_m: float, by_ac: bool) -> SceneUpdate:
    """Return a robot as a disc with an arrow, in the colour of its active controller."""
    colour = Color(*(AC_COLOUR if by_ac else SC_COLOUR))
    size = FoxgloveVector3(2.0 * radius_m, 2.0 * radius_m, ROBOT_HEIGHT_M)
    body = CylinderPrimitive(_at(0.0, 0.0, ROBOT_HEIGHT_M / 2.0), size, 1.0, 1.0, colour)
    arrow = ArrowPrimitive(
        _at(0.0, 0.0, ROBOT_HEIGHT_M), radius_m, radius_m / 3.0, radius_m / 2.0, radius_m / 1.5, colour
    )
    name = robot_frame(robot_id)
    entity = SceneEntity(time, name, name, Duration(), True, arrows=[arrow], cubes=[], cylinders=[body], lines=[])
    return SceneUpdate([entity])


def _seen(value: float) -> float:
    """Return a value rounded to what can be seen in a picture: invisible digits would be most of a file."""
    return round(value, 5)


def _at(x: float, y: float, z: float) -> FoxglovePose:
    return FoxglovePose(FoxgloveVector3(x, y, z), FoxgloveQuaternion())


def _cube(box: Box, height_m: float, colour: tuple[float, float, float, float]) -> CubePrimitive:
    x, y = box.centre
    size = FoxgloveVector3(box.high_x_m - box.low_x_m, box.high_y_m - box.low_y_m, height_m)
    return CubePrimitive(_at(x, y, height_m / 2.0), size, Color(*colour))
