"""The simulated vehicles as programs of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from tests.project.source import ROOT

WORLD: Final = {
    "width_m": 10,
    "depth_m": 10,
    "chargers": [[0, 0, 1, 1]],
    "robots": [{"id": 1, "x_m": 5, "y_m": 5}, {"id": 2, "x_m": 7, "y_m": 5, "battery": 0.5}],
}
"""An empty room with two robots."""

_ENVIRONMENT: Final = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))}


def finished(*arguments: str, world: str = json.dumps(WORLD)) -> subprocess.CompletedProcess[str]:
    """Run the program to its end."""
    return subprocess.run(
        [sys.executable, "-m", "soter_sim.mavlink", *arguments],
        cwd=ROOT, env=_ENVIRONMENT, input=world, capture_output=True, text=True, check=False, timeout=30.0,
    )  # fmt: skip


@contextmanager
def vehicles(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """Start the program; yields its process and what it says when it is ready."""
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "soter_sim.mavlink", "-", "--parent", str(os.getpid()), *arguments],
        cwd=ROOT, env=_ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(WORLD))
        process.stdin.close()
        try:
            yield process, json.loads(process.stdout.readline())
        finally:
            process.kill()
