"""From a decision to the first velocity at a ROS 2 robot's base, over a bare publisher and subscriber of rclpy.

A robot is driven by its AC. At the decision the supervisor's thread hands it over to the SC, as a disengagement does.
The time ends with the first velocity at the base that is not the AC's; it has come through the mux, which is a process
of its own. In turns with that, a bare publisher of the same process sends a message of the same kind straight to the
same listener, which is a process of its own too. With load, as many more processes spin as there are cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from benchmarks.common import ROOT, Row, arguments, show

ROUNDS = 300
LISTENER = """
import json, sys, time
from geometry_msgs.msg import Twist
from soter.adapters.ros2.graph import Graph

heard = []
graph = Graph(int(sys.argv[1]), use_sim_time=False, on_loopback=True)
node = graph.node("/listener")
def note(topic):
    return lambda each: heard.append((topic, time.monotonic(), each.linear.x, each.angular.z))
node.create_subscription(Twist, "/robot1/cmd_vel", note("base"), 50)
node.create_subscription(Twist, "/bare", note("bare"), 50)
graph.wait_for(lambda: bool(heard), 30.0)
print("ready", flush=True)
sys.stdin.read()
graph.close()
print(json.dumps(heard), flush=True)
"""


@contextmanager
def load(processes: int) -> Iterator[None]:
    """Keep cores busy."""
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def measure(rounds: int) -> tuple[list[float], list[float]]:
    """Return the times of so many decisions, and of so many bare messages, in milliseconds."""
    from geometry_msgs.msg import Twist, Vector3

    from soter.adapters.ros2.backend import Ros2Fleet, simulated
    from soter.adapters.ros2.loopback import environment
    from soter.adapters.ros2.options import Ros2Config
    from soter.adapters.ros2.simulator import Simulator
    from soter.runner.real_time import real_time
    from soter.sdk import Controller, RobotSpec, Waypoint
    from soter.workspace import Box, RobotPlace, Workspace

    room = Workspace(20.0, 20.0, (), (RobotPlace(1, 10.0, 10.0, Box(0.0, 0.0, 20.0, 20.0)),))
    specs = [RobotSpec(1, 10.0, 10.0, 0.0)]
    decided: list[float] = []
    sent: list[float] = []
    with ExitStack() as stack:
        simulator = Simulator(room, specs)
        stack.callback(simulator.close)
        env = {**environment(), "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        listener = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", LISTENER, str(simulator.domain_id)], stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, env=env, text=True,
            )
        )  # fmt: skip
        fleet = stack.enter_context(Ros2Fleet(simulated(Ros2Config(workspace=room), simulator), specs, None))
        (robot,), clock = fleet.ros2_robots, fleet.clock
        robot.init(30.0)
        bare = robot.node.create_publisher(Twist, "/bare", 1)
        assert listener.stdout is not None
        assert listener.stdout.readline() == "ready\n"

        def tick(ticks: int) -> None:
            for _ in range(ticks):
                clock.sleep_until(clock.now() + 0.05)
                robot.read_state()
                robot.renew_lease()

        tick(10)
        # As the supervisor of a run is, where the kernel allows it; the bare publisher is in the same process.
        stack.enter_context(real_time(required=False))
        for number in range(rounds):
            robot.switch_ac_sc(Controller.AC, "benchmark")
            # To and fro, so that the AC always asks for something.
            robot.goto(Waypoint(10.0 + (3.0 if number % 2 else -3.0), 10.0), Controller.AC)
            tick(4)
            decided.append(time.monotonic())
            robot.switch_ac_sc(Controller.SC, "benchmark")
            tick(2)
            sent.append(time.monotonic())
            bare.publish(Twist(linear=Vector3(x=float(number + 1))))
            tick(1)
        said, _ = listener.communicate("", timeout=30.0)
        heard = json.loads(said)
    rests = [at_s for topic, at_s, x, w in heard if topic == "base" and x == 0.0 and w == 0.0]
    moved = [at_s for topic, at_s, x, w in heard if topic == "base" and (x != 0.0 or w != 0.0)]
    arrived = {round(x): at_s for topic, at_s, x, _ in heard if topic == "bare"}
    # Only where the AC was really driving until then.
    driven = [at_s for at_s in decided if any(at_s - 0.05 < each <= at_s + 0.02 for each in moved)]
    found = [1e3 * (min(each for each in rests if each >= at_s) - at_s) for at_s in driven]
    return found, [1e3 * (arrived[number + 1] - at_s) for number, at_s in enumerate(sent) if number + 1 in arrived]


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    rounds = 5 if arguments(__doc__ or "", argv).quick else ROUNDS
    rows = []
    for name, processes in (("", 0), (", with load", os.cpu_count() or 1)):
        with load(processes):
            decisions, messages = measure(rounds)
        (p50, p99), (bare50, bare99) = np.percentile(decisions, (50, 99)), np.percentile(messages, (50, 99))
        rows += [
            Row(f"bare message{name}, p50 / p99 of {len(messages)}", f"{bare50:.2f} / {bare99:.2f} ms"),
            Row(
                f"decision{name}, p50 / p99 of {len(decisions)}", f"{p50:.2f} / {p99:.2f} ms", p50 / bare50,
                "45 ms", bool(p99 <= 45.0),
            ),
        ]  # fmt: skip
    show("From a decision to the first velocity at the base", rows)


if __name__ == "__main__":
    main()
