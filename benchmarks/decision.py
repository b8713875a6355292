"""What one decision of each module costs, against the least that any Python function could do with the same sample.

The decisions are those of the surveillance mission's own modules, on robots all over the workspace that their AC
may keep; for the battery's, on a robot that drives on and on, with its return path kept up to date, as in a run. The
reference is a call that computes one `math.hypot` of the position. Modules whose margin falls as robots move are
measured with every reach model that a mission may choose.
"""

from __future__ import annotations

import itertools
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
from soter.stack.battery import ChargeForTheWayHome
from soter.stack.return_path import ReturnPath
from soter.stack.right_of_way import BATTERY
from soter.stack.site_terrain import terrain_of

GOAL_US = 5.0
TUBE_GOAL_US = 20.0
"""With a reach model that looks at how robots move."""

INIT_TIMEOUT_S = 10.0
TICK_S = 0.05
SPEED_M_S = 0.22
KEPT_M = 0.45
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


def drive(workspace: Workspace) -> Iterator[Situation]:
    """Yield what robot 1 sees, tick by tick, where no module takes it from its AC; robot 2 stands on its station."""
    stream, terrain = random.Random(1), terrain_of(workspace, 0.105)
    x, y = workspace.robots[0].charger.centre
    beside, heading = workspace.robots[1].charger.centre, 0.5
    for tick in itertools.count():
        ahead = x + 0.3 * math.cos(heading), y + 0.3 * math.sin(heading)
        near_m = min(terrain.clearance_m(*ahead), terrain.fence_m(*ahead), math.dist(ahead, beside) - 0.6)
        heading += 0.2 if near_m < KEPT_M else stream.uniform(-0.05, 0.05)
        x, y = x + SPEED_M_S * TICK_S * math.cos(heading), y + SPEED_M_S * TICK_S * math.sin(heading)
        situation = Situation(1, _state(1, x, y, heading, tick * TICK_S), tick * TICK_S)
        situation.peers = [_state(2, *beside, 0.0, tick * TICK_S)]
        yield situation


def _state(robot_id: int, x_m: float, y_m: float, heading_rad: float, stamp_s: float) -> RobotState:
    speed_m_s = SPEED_M_S if robot_id == 1 else 0.0
    return RobotState(
        robot_id, stamp_s, stamp_s, x_m, y_m, 0.0, math.remainder(heading_rad, math.tau),
        speed_m_s * math.cos(heading_rad), speed_m_s * math.sin(heading_rad), 0.0, 1.0, Controller.AC, None, Link.UP,
    )  # fmt: skip


def judge_of(module: DecisionModule) -> Callable[[Situation], object]:
    """Return what judges at every tick; the battery's module has the return path kept for it, as in a run."""
    about = module.module.phi_safe
    return partial(_with_path, about.dock.path, module) if isinstance(about, ChargeForTheWayHome) else module.decide


def _with_path(path: ReturnPath, module: DecisionModule, view: Situation) -> None:
    path.track(view.own.x_m, view.own.y_m)
    module.decide(view)


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
        found = {module.name: module for module in modules}
        for model in TUBES:
            _, tubes = stack.enter_context(bound_modules(model))
            found |= {f"{module.name}, {model}": module for module in tubes if module.name in MOVING}
        views = situations(workspace, modules, count)
        driven = [*itertools.islice(drive(workspace), count)]
        for module in found.values():
            module.mode = Controller.AC
        sides: dict[str, Callable[[], float]] = {"reference": partial(median_us, reference, views)}
        for name, module in found.items():
            sides[name] = partial(median_us, judge_of(module), driven if module.name == BATTERY else views)
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
