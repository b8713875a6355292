"""The simulated vehicles as programs of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import RobotSpec, RuleLimits
from soter.sdk.wire import describe
from tests.project.source import ROOT

_ROOM: Final = Workspace(10.0, 10.0, (), (RobotPlace(1, 0.5, 0.5, Box(0.0, 0.0, 1.0, 1.0)),))


def world_of(*robots: RobotSpec) -> bytes:
    """Return an empty room with robots, as the program reads it."""
    return describe(_ROOM, robots, RuleLimits())


WORLD: Final = world_of(RobotSpec(1, 5.0, 5.0, 0.0), RobotSpec(2, 7.0, 5.0, 0.0, battery=0.5))
"""An empty room with two robots."""

_ENVIRONMENT: Final = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))}


def finished(*arguments: str, world: bytes = WORLD) -> subprocess.CompletedProcess[bytes]:
    """Run the program to its end."""
    return subprocess.run(
        [sys.executable, "-m", "soter_sim.mavlink", *arguments],
        cwd=ROOT, env=_ENVIRONMENT, input=world, capture_output=True, check=False, timeout=30.0,
    )  # fmt: skip


@contextmanager
def vehicles(*arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], dict[str, Any]]]:
    """Start the program; yields its process and what it says when it is ready."""
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "soter_sim.mavlink", "--parent", str(os.getpid()), *arguments],
        cwd=ROOT, env=_ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(WORLD)
        process.stdin.close()
        try:
            yield process, json.loads(process.stdout.readline())
        finally:
            process.kill()
