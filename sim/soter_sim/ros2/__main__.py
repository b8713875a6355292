"""The simulated robots as a program; `python -m soter_sim.ros2 --help`."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading

from pydantic import TypeAdapter

from soter.sdk.values import RobotSpec
from soter.workspace import Workspace
from soter_sim.ros2.face import Face


def main() -> None:
    """Run until interrupted or, with `--parent PID`, until that process is gone."""
    parser = argparse.ArgumentParser(
        prog="python -m soter_sim.ros2", description="Simulated ROS 2 robots, in real time; the world comes as JSON on "
        "standard input.",
    )  # fmt: skip
    parser.add_argument("--namespaces", required=True, metavar="1=/robot1,...", help="by robot, where its topics are")
    parser.add_argument("--stamped", action="store_true", help="velocities are TwistStamped")
    parser.add_argument("--truth-port", type=int, default=0, help="where to tell the truth; 0 for any that is free")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    given = parser.parse_args()
    namespaces = {
        int(number): name for number, _, name in (each.partition("=") for each in given.namespaces.split(","))
    }
    workspace, robots = TypeAdapter(tuple[Workspace, tuple[RobotSpec, ...]]).validate_json(sys.stdin.buffer.read())
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        # Not an exception: it could come where rclpy ignores it.
        signal.signal(number, lambda *_: ended.set())
    face = Face(workspace, robots, namespaces, stamped=given.stamped, truth_port=given.truth_port)
    try:
        sys.stdout.write(json.dumps({"truth": face.truth.address}) + "\n")
        sys.stdout.flush()
        face.run(lambda: ended.is_set() or (given.parent is not None and os.getppid() != given.parent))
    finally:
        face.close()


if __name__ == "__main__":
    main()
