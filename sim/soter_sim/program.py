"""What the programs of simulated robots on a wire have in common."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from soter.geometry.site import SitePlan, from_plain
from soter.geometry.workspace import Workspace
from soter.onboard.program import LEAVE_S, Ending, killed_after
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.real_time import RealTimeWorld

_NICE: Final = -10


def make_parser(module: str, what: str, example: str | None = None) -> argparse.ArgumentParser:
    """Return a parser of what all of them are told.

    Args:
        module: what Python is told to run.
        what: what the robots are called.
        example: of what names a robot whose base is sent velocities; None for other robots.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}", description=f"Simulated {what}, in real time; the world comes as JSON on "
        "standard input.",
    )  # fmt: skip
    if example is not None:
        parser.add_argument(
            "--namespaces", required=True, metavar=f"1={example},...", help="by robot, where its messages are"
        )
        parser.add_argument("--stamped", action="store_true", help="velocities are TwistStamped")
    parser.add_argument("--truth-port", type=int, default=0, help="where to tell the truth; 0 for any that is free")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    return parser


def read_namespaces(text: str) -> dict[int, str]:
    """Read what `--namespaces` says."""
    return {int(number): name for number, _, name in (each.partition("=") for each in text.split(","))}


def read_world() -> tuple[Workspace, Sequence[RobotSpec], RuleLimits]:
    """Read the world that comes on standard input, and what its mission promises."""
    made_of, robots, limits = TypeAdapter(tuple[Workspace | SitePlan, tuple[RobotSpec, ...], RuleLimits]).validate_json(
        sys.stdin.buffer.read()
    )
    return from_plain(made_of), robots, limits


def serve(endpoint: RealTimeWorld, ended: Ending, **told: object) -> None:
    """Say where the truth is, and what else is told, in a line of JSON; then run until it is to end."""
    try:
        sys.stdout.write(json.dumps({"truth": endpoint.truth.address, **told}) + "\n")
        sys.stdout.flush()
        _favour()
        endpoint.run(ended)
    finally:
        with killed_after(LEAVE_S):
            endpoint.close()


def _favour() -> None:
    """Let all threads wait less for what the host does besides, where the kernel allows it.

    Robots have computers of their own. What commands them may be scheduled in real time, and comes first all the same.
    """
    with suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(task.name), _NICE)
