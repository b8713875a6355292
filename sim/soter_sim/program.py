"""The common part of the programs of simulated robots on a wire."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from soter.geometry.site import SitePlan, from_plain
from soter.geometry.workspace import Workspace
from soter.onboard.program import LEAVE_S, Ending, killed_after
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.real_time import RealTimeWorld

_NICE: Final = -10


def make_parser(module: str, what: str, example: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of their common arguments.

    Args:
        module: the module that Python runs.
        what: the robots' name in messages.
        example: example of a namespace, for robots whose bases are sent velocities; None for other robots.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}", description=f"Simulated {what}, in real time; the world comes as MessagePack on "
        "standard input.",
    )  # fmt: skip
    if example is not None:
        parser.add_argument(
            "--namespaces", required=True, metavar=f"1={example},...", help="by robot, where its messages are"
        )
        parser.add_argument("--stamped", action="store_true", help="velocities are TwistStamped")
    parser.add_argument("--truth-port", type=int, default=0, help="serve ground truth on this port; 0 for any free one")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    return parser


def read_namespaces(text: str) -> dict[int, str]:
    """Return the value of `--namespaces`."""
    return {int(number): name for number, _, name in (each.partition("=") for each in text.split(","))}


def read_world() -> tuple[Workspace, Sequence[RobotSpec], RuleLimits]:
    """Read a world, and what its mission promises, from standard input.

    Raises:
        ValueError: there is none.
    """
    try:
        room, site, robots, limits = msgspec.msgpack.decode(
            sys.stdin.buffer.read(), type=tuple[Workspace | None, SitePlan | None, tuple[RobotSpec, ...], RuleLimits]
        )
    except msgspec.DecodeError as failure:
        raise ValueError(f"standard input holds no world: {failure}") from failure
    made_of = room if site is None else site
    if made_of is None:
        raise ValueError("standard input holds no world: it has neither a room nor a site")
    return from_plain(made_of), robots, limits


def serve(endpoint: RealTimeWorld, ended: Ending, **told: object) -> None:
    """Print the address of the truth, and `told`, as a line of JSON; then run until it is to end."""
    try:
        # Who has started it may be gone by now, which `ended` then says.
        with suppress(BrokenPipeError):
            os.write(sys.stdout.fileno(), f"{json.dumps({'truth': endpoint.truth.address, **told})}\n".encode())
        _favour()
        endpoint.run(ended)
    finally:
        with killed_after(LEAVE_S):
            endpoint.close()


def _favour() -> None:
    """Have all threads wait less for other work of the host, where the kernel allows it.

    Real robots have computers of their own. A supervisor that is scheduled in real time still comes first.
    """
    with suppress(OSError):
        for task in Path("/proc/self/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(task.name), _NICE)
