"""Records what a mission's wheels were told, and drives a bare world with it.

The bare world does all that the mission's world did (physics, batteries, truth) and its robots' states are read as
often, but nothing decides anything. What a mission takes longer is what the stack costs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from soter.adapters.pybullet import KinematicConfig, PyBulletBackend, PyBulletConfig, SimulatedFleet
from soter.config import MissionFile
from soter.geometry.workspace import Workspace
from soter.runner import run_mission
from soter.sdk import RobotSpec
from soter_sim import Control, World

INIT_TIMEOUT_S = 10.0

Step = tuple[float, float, float, float]
"""Where a robot was at the beginning of a control period (x_m, y_m), and what it was told (v_m_s, yaw_rate_rad_s)."""


@dataclass(slots=True)
class Tape:
    """The wheel commands of one run.

    Attributes:
        workspace: where it was.
        specs: who.
        engine: name of the engine.
        ticks: how many.
        tick_s: how long each took.
        steps: by robot id, one for each control period.
    """

    workspace: Workspace
    specs: Sequence[RobotSpec]
    engine: str
    ticks: int = 0
    tick_s: float = 0.0
    steps: dict[int, list[Step]] = field(default_factory=dict)


class _RecordingWorld(World):
    """A world that writes down what each robot's control returns."""

    def __init__(self, tape: Tape) -> None:
        super().__init__(tape.workspace, tape.specs, tape.engine)
        self._tape = tape

    def set_control(self, robot_id: int, control: Control | None) -> None:
        if control is None:
            super().set_control(robot_id, None)
            return
        steps = self._tape.steps.setdefault(robot_id, [])

        def record(now_s: float, x: float, y: float, heading: float, v: float, yaw_rate: float) -> tuple[float, float]:
            command = control(now_s, x, y, heading, v, yaw_rate)
            steps.append((x, y, *command))
            return command

        super().set_control(robot_id, record)


class RecordingBackend(PyBulletBackend):
    """The backend `pybullet` with a tape running."""

    tape: ClassVar[Tape | None] = None

    def open(self, config: PyBulletConfig | KinematicConfig, robots: Sequence[RobotSpec]) -> SimulatedFleet:
        tape = Tape(config.workspace, tuple(robots), config.engine)
        RecordingBackend.tape = tape
        return SimulatedFleet(_RecordingWorld(tape), robots)


NAME = f"{RecordingBackend.__module__}:{RecordingBackend.__qualname__}"


def record(mission: MissionFile, engine: str) -> Tape:
    """Run a mission on an engine and return what its wheels were told."""
    backends = {**mission.backends, NAME: {"engine": engine}}
    result = run_mission(mission.model_copy(update={"backend": NAME, "backends": backends})).result
    tape = RecordingBackend.tape
    if tape is None or result.status != "completed":
        raise RuntimeError(f"nothing was recorded: the run {result.status} {result.failure}")
    tape.tick_s = mission.base_tick_s
    tape.ticks = round(result.duration_s / mission.base_tick_s)
    return tape


def replay(tape: Tape, *, verify: bool = False) -> float:
    """Drive a bare world with a tape, reading all states at every tick; return the host time in seconds.

    Args:
        tape: from `record`.
        verify: check in every control period that the robots are exactly where they were in the recorded run.
    """
    world = World(tape.workspace, tape.specs, tape.engine)
    with SimulatedFleet(world, tape.specs) as fleet:
        for robot in fleet.robots:
            robot.init(INIT_TIMEOUT_S)
            steps = tape.steps[robot.id]
            world.set_control(robot.id, _checked(steps) if verify else _player(steps))
        reads = [robot.read_state for robot in fleet.robots]
        clock, tick_s = fleet.clock, tape.tick_s
        start_s = time.perf_counter()
        for tick in range(tape.ticks):
            for read_state in reads:
                read_state()
            clock.sleep_until((tick + 1) * tick_s)
        wall_s = time.perf_counter() - start_s
        for robot in fleet.robots:
            world.set_control(robot.id, None)
    return wall_s


def _player(steps: Sequence[Step]) -> Control:
    commands: Iterator[tuple[float, float]] = iter([(v, yaw_rate) for _, _, v, yaw_rate in steps])

    def play(*_state: float) -> tuple[float, float]:
        return next(commands)

    return play


def _checked(steps: Sequence[Step]) -> Control:
    recorded = iter(steps)

    def play(now_s: float, x: float, y: float, *_state: float) -> tuple[float, float]:
        was_x, was_y, v, yaw_rate = next(recorded)
        if (x, y) != (was_x, was_y):
            raise RuntimeError(f"the replay left the recorded run at {now_s:.3f} s")
        return v, yaw_rate

    return play
