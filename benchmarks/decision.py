"""What one decision of each module costs, against the least that any Python function could do with the same sample.

The decisions are those of the surveillance mission's own modules, on robots all over the workspace that their AC
may keep; the reference is a call that computes one `math.hypot` of the position.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from soter.adapters.pybullet import KinematicBackend, KinematicConfig
from soter.config import load_mission
from soter.rta import DecisionModule, Mode, Situation
from soter.sdk import Controller, Link, RobotSpec, RobotState
from soter.stack.assembly import assemble
from soter.workspace import Workspace

GOAL_US = 5.0
INIT_TIMEOUT_S = 10.0


@contextmanager
def bound_modules() -> Iterator[tuple[Workspace, Sequence[DecisionModule]]]:
    """Yield the workspace and the decision modules of robot 1, bound as in a run."""
    mission = load_mission(SURVEILLANCE, {"backend": "kinematic"})
    workspace = mission.read_workspace()
    specs = [RobotSpec(place.id, place.x_m, place.y_m, place.heading_rad) for place in workspace.robots]
    with KinematicBackend().open(KinematicConfig(workspace=workspace), specs) as fleet:
        for robot in fleet.robots:
            robot.init(INIT_TIMEOUT_S)
        safety = assemble(mission, workspace, fleet.robots, lambda report: None)
        safety.supervisor.tick(0.0)
        yield workspace, safety.supervisor.robots[fleet.robots[0].id].modules


def situations(workspace: Workspace, modules: Sequence[DecisionModule], count: int) -> list[Situation]:
    """Return situations of robot 1, with one peer, that no module takes for dangerous."""
    stream = random.Random(1)

    def state(robot_id: int) -> RobotState:
        heading, speed = stream.uniform(-math.pi, math.pi), stream.uniform(0.0, 0.22)
        return RobotState(
            robot_id, 1.0, 1.0, stream.uniform(0.0, workspace.width_m), stream.uniform(0.0, workspace.depth_m), 0.0,
            heading, speed * math.cos(heading), speed * math.sin(heading), 0.0, stream.uniform(0.8, 1.0),
            Controller.AC, None, Link.UP,
        )  # fmt: skip

    found: list[Situation] = []
    while len(found) < count:
        situation = Situation(1, state(1), 1.0)
        situation.peers = [state(2)]
        if not any(_fires(module, situation) for module in modules):
            found.append(situation)
    return found


def _fires(module: DecisionModule, situation: Situation) -> bool:
    module.mode = Mode.AC
    return module.decide(situation)


def reference(situation: Situation) -> float:
    """Do next to nothing with a sample."""
    own = situation.own
    return math.hypot(own.x_m, own.y_m)


def median_us(judge: Callable[[Situation], object], views: Sequence[Situation]) -> float:
    """Return the median time of one call, that of looking at the clock included."""
    clock_ns = time.perf_counter_ns
    times_ns = []
    for view in views:
        start_ns = clock_ns()
        judge(view)
        times_ns.append(clock_ns() - start_ns)
    return statistics.median(times_ns) / 1e3


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure and print; return the medians in microseconds by module."""
    quick = arguments(__doc__ or "", argv).quick
    count, rounds = (20, 2) if quick else (2000, 25)
    with bound_modules() as (workspace, modules):
        views = situations(workspace, modules, count)
        sides = {"reference": partial(median_us, reference, views)}
        sides |= {module.name: partial(median_us, module.decide, views) for module in modules}
        for module in modules:
            module.mode = Mode.AC
        times = in_turns(sides, rounds)
    medians = {name: statistics.median(each) for name, each in times.items()}
    plain_us = medians.pop("reference")
    rows = [Row("one call with math.hypot", f"{plain_us:.2f} us")]
    rows += [
        Row(name, f"{us:.2f} us", us / plain_us, f"<= {GOAL_US:g} us", us <= GOAL_US) for name, us in medians.items()
    ]
    show("One decision", rows, f"Medians of {rounds} rounds over {count} situations.")
    return medians


if __name__ == "__main__":
    main()
