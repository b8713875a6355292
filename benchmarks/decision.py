"""What one decision of each module costs, against the least that any Python function could do with the same sample.

The decisions are those of the surveillance mission's own modules, on robots all over the workspace that their AC
may keep; the reference is a call that computes one `math.hypot` of the position. Modules whose margin falls as robots
move are measured with every reach model that a mission may choose.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial

from benchmarks.common import SURVEILLANCE, Row, arguments, in_turns, show
from soter.adapters.pybullet import KinematicBackend, KinematicConfig
from soter.config import load_mission
from soter.config.tables import MotionModel
from soter.geometry.workspace import Workspace
from soter.rta import DecisionModule, Situation
from soter.sdk import Controller, Link, RobotSpec, RobotState
from soter.stack.assembly import assemble

GOAL_US = 5.0
TUBE_GOAL_US = 20.0
"""With a reach model that looks at how robots move."""

INIT_TIMEOUT_S = 10.0
MOVING = ("collision", "obstacle", "geofence")
TUBES: tuple[MotionModel, ...] = ("speed-acceleration", "unicycle")


@contextmanager
def bound_modules(
    model: MotionModel = "speed", workspace: Workspace | None = None, drive_s: float = 1800.0
) -> Iterator[tuple[Workspace, Sequence[DecisionModule]]]:
    """Yield the workspace and the decision modules of robot 1, bound as in a run, with one reach model for all.

    A full battery lasts for `drive_s`.
    """
    chosen: dict[str, object] = {f"rta.{name}.model": model for name in MOVING}
    chosen |= {"backend": "kinematic", "battery.drive_s": drive_s, "battery.idle_s": 4.0 * drive_s}
    mission = load_mission(SURVEILLANCE, chosen)
    workspace = workspace or mission.read_workspace()
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
    module.mode = Controller.AC
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
    """Measure and print; return the medians in microseconds by module, and by module and model for the tubes."""
    quick = arguments(__doc__ or "", argv).quick
    count, rounds = (20, 2) if quick else (2000, 25)
    with bound_modules() as (workspace, modules), ExitStack() as stack:
        judges = {module.name: module for module in modules}
        for model in TUBES:
            _, tubes = stack.enter_context(bound_modules(model))
            judges |= {f"{module.name}, {model}": module for module in tubes if module.name in MOVING}
        views = situations(workspace, modules, count)
        for judge in judges.values():
            judge.mode = Controller.AC
        sides: dict[str, Callable[[], float]] = {"reference": partial(median_us, reference, views)}
        sides |= {name: partial(median_us, judge.decide, views) for name, judge in judges.items()}
        times = in_turns(sides, rounds)
    medians = {name: statistics.median(each) for name, each in times.items()}
    plain_us = medians.pop("reference")
    rows = [Row("one call with math.hypot", f"{plain_us:.2f} us")]
    for name, us in medians.items():
        goal_us = TUBE_GOAL_US if "," in name else GOAL_US
        rows.append(Row(name, f"{us:.2f} us", us / plain_us, f"<= {goal_us:g} us", us <= goal_us))
    show("One decision", rows, f"Medians of {rounds} rounds over {count} situations.")
    return medians


if __name__ == "__main__":
    main()
