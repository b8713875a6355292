"""From a decision to the first velocity at a ROS 2 robot's base, over a bare publisher and subscriber of rclpy.

How that is measured is said in `switching.py`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack

from benchmarks import switching
from benchmarks.common import ROOT, arguments, show

LISTENER = """
import json, sys, time
from geometry_msgs.msg import Twist
from soter.adapters.ros2.graph import Graph
from soter.adapters.velocity_controlled.robot import wait_for

heard = []
graph = Graph(int(sys.argv[1]), use_sim_time=False, on_loopback=True)
node = graph.node("/listener")
def note(name):
    return lambda each: heard.append((name, time.monotonic(), each.linear.x, each.angular.z))
node.create_subscription(Twist, "/robot1/cmd_vel", note("base"), 50)
node.create_subscription(Twist, "/bare", note("bare"), 50)
wait_for(lambda: bool(heard), 30.0)
print("ready", flush=True)
sys.stdin.read()
graph.close()
print(json.dumps(heard), flush=True)
"""


def measure(rounds: int) -> tuple[list[float], list[float]]:
    """Return the times of so many decisions, and of so many bare messages, in milliseconds."""
    from geometry_msgs.msg import Twist, Vector3

    from soter.adapters.ros2.backend import Ros2Backend
    from soter.adapters.ros2.options import Ros2Config
    from soter.adapters.ros2.simulator import Ros2Simulator, environment

    with ExitStack() as stack:
        simulator = Ros2Simulator(switching.ROOM, switching.SPECS)
        stack.callback(simulator.close)
        env = {**environment(), "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        listener = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", LISTENER, str(simulator.domain_id)], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, env=env, text=True,
            )
        )  # fmt: skip
        config = Ros2Backend.located(Ros2Config(workspace=switching.ROOM), simulator)
        fleet = stack.enter_context(Ros2Backend().open(config, switching.SPECS))
        (robot,) = fleet.robots
        robot.init(30.0)
        bare = robot.node.create_publisher(Twist, "/bare", 1)
        return switching.measure(robot, lambda number: bare.publish(Twist(linear=Vector3(x=number))), listener, rounds)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    quick = arguments(__doc__ or "", argv).quick
    show("From a decision to the first velocity at the base", switching.measured_rows(measure, quick=quick))


if __name__ == "__main__":
    main()
