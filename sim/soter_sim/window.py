"""The engine with physics, shown in a window of the host's display."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Final

from soter.errors import BackendError
from soter.geometry.workspace import Workspace
from soter_sim.pybullet import PyBulletEngine, bullet, nothing_printed
from soter_sim.still import Scene

_YAW_DEG: Final = 12.0
_PITCH_DEG: Final = -52.0
_AWAY: Final = 0.95
"""Distance of the camera per metre of the workspace's width."""


class WindowEngine(PyBulletEngine):
    """A PyBullet engine that shows its world, with the same motions, only slower. One at a time per process.

    Raises:
        BackendError: there is no display, PyBullet cannot use it, or the window was closed while the world moved.
    """

    def run(self, until_period: int) -> None:
        try:
            super().run(until_period)
        except bullet.error as failure:
            self.close()
            raise BackendError(f"the window of the world is closed ({failure})") from failure

    def close(self) -> None:
        # Closing the window has already ended its world.
        with nothing_printed(), suppress(bullet.error):
            super().close()

    def _connect(self) -> int:
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            raise BackendError("PyBullet has no display for its window: DISPLAY is not set; --live needs none")
        with nothing_printed():
            try:
                return bullet.connect(bullet.GUI)
            except bullet.error as failure:
                raise BackendError(f"PyBullet cannot open a window: {failure}") from failure

    def _build(self, workspace: Workspace) -> frozenset[int]:
        """Set up ground and boxes, draw what has no body, and set the camera to the south and above."""
        boxes, client = super()._build(workspace), self._client
        for part in (bullet.COV_ENABLE_GUI, bullet.COV_ENABLE_SHADOWS):
            bullet.configureDebugVisualizer(part, 0, physicsClientId=client)
        Scene(client).lines(workspace)
        low_x, low_y, high_x, high_y = workspace.bounds
        bullet.resetDebugVisualizerCamera(
            _AWAY * max(high_x - low_x, high_y - low_y), _YAW_DEG, _PITCH_DEG,
            ((low_x + high_x) / 2, (low_y + high_y) / 2, 0.0), physicsClientId=client,
        )  # fmt: skip
        return boxes
