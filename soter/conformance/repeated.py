"""The same calls in processes of their own: what hangs on the order of a set is alike in one, and unlike in another."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import Final

from soter.conformance.bench import Bench
from soter.conformance.find import find_harness
from soter.sdk import RobotState

STRAIGHT_BEHIND: Final = (-0.3, 0.0)
_WAYS: Final = (STRAIGHT_BEHIND, (0.2, 0.3))
_SEEDS: Final = range(6)
_LIMIT_S: Final = 120.0
_PROGRAM: Final = "import sys; from soter.conformance.repeated import main; main(sys.argv[1])"


def digests(target: str) -> list[str]:
    """Return what the samples of the same calls come to in processes that order sets and hash texts differently.

    Args:
        target: what `find_harness` finds the harness by.

    Raises:
        RuntimeError: a process failed; the message has the last line that it said.
    """
    began = [
        subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, target],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": str(seed)},
        )
        for seed in _SEEDS
    ]  # fmt: skip
    try:
        said = [each.communicate(timeout=_LIMIT_S) for each in began]
    finally:
        for each in began:
            each.kill()
            each.wait()
    for each, (_, errors) in zip(began, said, strict=True):
        if each.returncode:
            last = (errors.strip().splitlines() or [f"exit code {each.returncode}"])[-1]
            raise RuntimeError(f"in a process of its own the same calls failed: {last}")
    return [output.strip() for output, _ in said]


def main(target: str) -> None:
    """Do the calls on one fresh robot, and write the digest of its samples."""
    bench = Bench(find_harness(target))
    try:
        sys.stdout.write(_digest(states_of(bench, _WAYS)))
    finally:
        bench.close()
        bench.harness.close()


def states_of(bench: Bench, ways: Sequence[tuple[float, float]]) -> tuple[RobotState, ...]:
    """Return the samples of a fresh robot that was sent to places ahead and to the left of its start."""
    robot = bench.open_one()
    for ahead, left in ways:
        bench.go(robot, bench.place(robot, ahead, left))
    return tuple(sample.state for sample in bench.tracks[robot.id])


def _digest(states: Sequence[RobotState]) -> str:
    return hashlib.sha256(repr([tuple(each) for each in states]).encode()).hexdigest()
