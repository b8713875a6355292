"""A workspace and its robots as a picture in three dimensions, drawn by PyBullet without a display."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from soter.errors import BackendError
from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter_sim.pybullet import bullet

Colour = tuple[float, float, float]
"""Red, green and blue from 0 to 1."""

_FLOOR: Final = (0.93, 0.94, 0.95)
_FENCE: Final = (0.20, 0.22, 0.26)
_BOX: Final = (0.44, 0.48, 0.54)
_CHARGER: Final = (0.62, 0.88, 0.78)
_DARK: Final = (0.15, 0.17, 0.20)
_FENCE_M: Final = (0.04, 0.10)
"""Thickness and height of a fence in the picture; workspaces do not have them."""

_RIM: Final = 3.0
"""Size of the floor relative to the workspace, so that the picture does not show the floor's edge."""

_BODY_M: Final = 0.18
_FIELD_DEG: Final = 34.0
_LIGHT: Final = (-0.5, -1.0, 2.2)
_SHADE: Final = (0.80, 0.81, 0.83)
_SHADE_M: Final = (0.16, 0.05)
"""Offset of a shadow per metre of a body's height. The library's own shadows would also fall on the bodies."""


class Standing(NamedTuple):
    """A robot in a picture.

    Attributes:
        x_m: east.
        y_m: north.
        heading_rad: counter-clockwise from east.
        radius_m: radius of its body.
        body: colour of its body.
        band: colour of its active controller.
        trail: places that it has passed, x and y in metres, in order.
    """

    x_m: float
    y_m: float
    heading_rad: float
    radius_m: float
    body: Colour
    band: Colour
    trail: Sequence[tuple[float, float]] = ()


def photograph(
    workspace: Workspace, robots: Sequence[Standing], width_px: int, height_px: int
) -> npt.NDArray[np.uint8]:
    """Return a picture of robots in a workspace, seen from the south and above: rows of red, green and blue.

    Raises:
        BackendError: PyBullet has no room for another world in this process.
    """
    client = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise BackendError("PyBullet cannot open another world in this process: too many are open; close some")
    try:
        scene = Scene(client)
        scene.place(workspace)
        for each in robots:
            scene.robot(each)
        return _taken(client, workspace, width_px, height_px)
    finally:
        bullet.disconnect(physicsClientId=client)


class Scene:
    """Draws visual shapes, without bodies, in a PyBullet world.

    Args:
        client: the number of the world.
    """

    def __init__(self, client: int) -> None:
        self._client: Final = client

    def place(self, workspace: Workspace) -> None:
        """Draw the floor, and all of a workspace on it."""
        low_x, low_y, high_x, high_y = workspace.bounds
        rim_m = _RIM * max(high_x - low_x, high_y - low_y)
        middle, half = ((low_x + high_x) / 2, (low_y + high_y) / 2), ((high_x - low_x) / 2, (high_y - low_y) / 2)
        self._box((*middle, -0.05), (half[0] + rim_m, half[1] + rim_m, 0.05), _FLOOR)
        self.lines(workspace)
        if isinstance(workspace, Site):
            for area in workspace.plan.areas:
                for ring in area.pieces:
                    self._prism(ring, area.height_m)
            return
        for box in workspace.boxes:
            x_m, y_m = box.centre
            half = (box.high_x_m - box.low_x_m) / 2, (box.high_y_m - box.low_y_m) / 2
            self._box((x_m, y_m, box.height_m / 2), (*half, box.height_m / 2), _BOX)
            shade = x_m + _SHADE_M[0] * box.height_m, y_m + _SHADE_M[1] * box.height_m
            self._box((*shade, 0.001), (*half, 0.001), _SHADE)

    def lines(self, workspace: Workspace) -> None:
        """Draw the fence and the chargers."""
        for place in workspace.robots:
            x_m, y_m = place.charger.centre
            wide, deep = place.charger.high_x_m - place.charger.low_x_m, place.charger.high_y_m - place.charger.low_y_m
            self._box((x_m, y_m, 0.004), (wide / 2, deep / 2, 0.004), _CHARGER)
        fence, _ = workspace.outlines()
        for start, end in pairwise([*fence, fence[0]] if fence else []):
            self._bar(start, end, *_FENCE_M, _FENCE)

    def robot(self, robot: Standing) -> None:
        """Draw a robot: its body, a band in its active controller's colour, a nose, and its trail."""
        scale = robot.radius_m / 0.105
        high_m = _BODY_M * scale
        at = (robot.x_m, robot.y_m)
        self._disc((robot.x_m + 0.25 * high_m, robot.y_m, 0.001), robot.radius_m, 0.002, _SHADE)
        self._disc((*at, high_m / 2 + 0.01), robot.radius_m, high_m, robot.body)
        self._disc((*at, 0.78 * high_m), 1.06 * robot.radius_m, 0.2 * high_m, robot.band)
        self._disc((*at, high_m + 0.025 * scale), 0.5 * robot.radius_m, 0.05 * scale, _DARK)
        ahead = 0.75 * robot.radius_m
        nose = robot.x_m + ahead * math.cos(robot.heading_rad), robot.y_m + ahead * math.sin(robot.heading_rad)
        self._disc((*nose, high_m + 0.02 * scale), 0.2 * robot.radius_m, 0.03 * scale, (1.0, 1.0, 1.0))
        for start, end in pairwise(robot.trail):
            self._bar(start, end, 0.03, 0.01, robot.body)

    def _bar(
        self, start: tuple[float, float], end: tuple[float, float], wide_m: float, high_m: float, colour: Colour
    ) -> None:
        """Draw a bar along the ground from one place to another."""
        along = math.hypot(end[0] - start[0], end[1] - start[1])
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2, high_m / 2)
        turn = math.atan2(end[1] - start[1], end[0] - start[0])
        self._box(middle, ((along + wide_m) / 2, wide_m / 2, high_m / 2), colour, turn)

    def _box(self, middle: tuple[float, ...], half: tuple[float, ...], colour: Colour, turn_rad: float = 0.0) -> None:
        shape = bullet.createVisualShape(
            bullet.GEOM_BOX, halfExtents=half, rgbaColor=(*colour, 1.0), physicsClientId=self._client
        )
        self._put(shape, middle, turn_rad)

    def _disc(self, middle: tuple[float, ...], radius_m: float, high_m: float, colour: Colour) -> None:
        shape = bullet.createVisualShape(
            bullet.GEOM_CYLINDER, radius=radius_m, length=high_m, rgbaColor=(*colour, 1.0),
            specularColor=(0.2, 0.2, 0.2), physicsClientId=self._client,
        )  # fmt: skip
        self._put(shape, middle)

    def _prism(self, ring: Sequence[tuple[float, float]], high_m: float) -> None:
        """Draw a convex polygon as a prism: its sides, and a fan for its top."""
        corners = list(ring) if _turns_left(ring) else list(reversed(ring))
        count = len(corners)
        vertices = [(x, y, z) for x, y in corners for z in (0.0, high_m)]
        indices = [index for last in range(1, count - 1) for index in (1, 2 * last + 1, 2 * last + 3)]
        for first in range(count):
            second = (first + 1) % count
            indices += [2 * first, 2 * second, 2 * second + 1, 2 * first, 2 * second + 1, 2 * first + 1]
        shape = bullet.createVisualShape(
            bullet.GEOM_MESH, vertices=vertices, indices=indices, rgbaColor=(*_BOX, 1.0), physicsClientId=self._client
        )
        self._put(shape, (0.0, 0.0, 0.0))

    def _put(self, shape: int, place: Sequence[float], turn_rad: float = 0.0) -> None:
        bullet.createMultiBody(
            0.0, baseVisualShapeIndex=shape, basePosition=place,
            baseOrientation=(0.0, 0.0, math.sin(turn_rad / 2), math.cos(turn_rad / 2)), physicsClientId=self._client,
        )  # fmt: skip


def _turns_left(ring: Sequence[tuple[float, float]]) -> bool:
    return sum(ax * by - ay * bx for (ax, ay), (bx, by) in pairwise([*ring, ring[0]])) > 0.0


def _taken(client: int, workspace: Workspace, width_px: int, height_px: int) -> npt.NDArray[np.uint8]:
    """Take the picture from far enough away to show the whole workspace."""
    low_x, low_y, high_x, high_y = workspace.bounds
    size_m = max(high_x - low_x, high_y - low_y)
    away_m = 2.0 * size_m
    view = bullet.computeViewMatrixFromYawPitchRoll(
        ((low_x + high_x) / 2, (low_y + high_y) / 2 - 0.02 * size_m, 0.0), away_m, 12.0, -52.0, 0.0, 2
    )
    projection = bullet.computeProjectionMatrixFOV(_FIELD_DEG, width_px / height_px, 0.05 * away_m, 4.0 * away_m)
    _, _, pixels, _, _ = bullet.getCameraImage(
        width_px, height_px, view, projection, lightDirection=_LIGHT, lightColor=(1.0, 1.0, 1.0),
        shadow=0, lightAmbientCoeff=0.62, lightDiffuseCoeff=0.38, lightSpecularCoeff=0.05,
        renderer=bullet.ER_TINY_RENDERER, physicsClientId=client,
    )  # fmt: skip
    rows = np.asarray(pixels, dtype=np.uint8).reshape(height_px, width_px, 4)
    return rows[:, :, :3]
