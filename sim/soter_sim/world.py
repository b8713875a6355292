"""A world: robots, boxes, chargers and the truth about them, moved by one of two engines."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from types import TracebackType
from typing import Final, Self

from soter.errors import nearest
from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import Control, stand_still
from soter_sim.engine import Engine, EngineFactory
from soter_sim.impairment import Impairment, impaired
from soter_sim.kinematic import KinematicEngine
from soter_sim.truth import WorldTruth


def _pybullet(workspace: Workspace, specs: Sequence[RobotSpec], limits: RuleLimits) -> Engine:
    # Imported here, so that the other engine works where PyBullet is not installed.
    from soter_sim.pybullet import PyBulletEngine

    return PyBulletEngine(workspace, specs, limits)


def in_window(workspace: Workspace, specs: Sequence[RobotSpec], limits: RuleLimits) -> Engine:
    """Make an engine with physics that shows its world in a window of the host's display.

    Raises:
        BackendError: there is no display.
        ImportError: PyBullet is not installed.
    """
    from soter_sim.window import WindowEngine

    return WindowEngine(workspace, specs, limits)


ENGINES: Final[dict[str, EngineFactory]] = {"kinematic": KinematicEngine, "pybullet": _pybullet}
"""The engines by name."""

# A time that should be a whole number of periods may miss it by rounding.
_ROUNDING: Final = 1e-6


class World:
    """N differential-drive robots among boxes, on unbounded ground.

    Time begins at 0 and moves in whole control periods. Not thread-safe.

    Args:
        workspace: fence, boxes and chargers; its robots' starts are not used.
        robots: the robots, with their starts and charges.
        engine: a name from `ENGINES`, or a function that makes an engine.
        limits: what the mission promises, by which truth is judged.

    Attributes:
        engine: the engine, which only the world runs.
        bodies: the robots' states, in the order of `robots`.
        truth: the ground truth.
        now_s: the world's time; it only changes in `advance`.
        period_s: the control period.

    Raises:
        ValueError: there is no such engine, two robots have one id, or a start is not finite.
        ImportError: the engine's library is not installed.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        engine: str | EngineFactory = "kinematic",
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
    ) -> None:
        if isinstance(engine, str):
            if engine not in ENGINES:
                raise ValueError(f"engine is '{engine}', allowed: {sorted(ENGINES)}{nearest(engine, [*ENGINES])}")
            engine = ENGINES[engine]
        self.workspace = workspace
        self.engine = engine(workspace, robots, limits)
        self.bodies = self.engine.bodies
        self.period_s = self.engine.period_s
        self.truth = WorldTruth(self.engine.record, self.bodies)
        self.now_s = 0.0
        self._period = 0
        self._index = {robot_id: index for index, robot_id in enumerate(self.bodies.ids)}
        self._controls = [*self.bodies.control]
        self._closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def index(self, robot_id: int) -> int:
        """Return the index of a robot in the lists of `bodies`.

        Raises:
            ValueError: there is no such robot.
        """
        if robot_id not in self._index:
            raise ValueError(f"no robot {robot_id} in this world, allowed: {list(self.bodies.ids)}")
        return self._index[robot_id]

    def set_control(self, robot_id: int, control: Control | None) -> None:
        """Set the control of a robot from the next period on; None makes it stand still."""
        index = self.index(robot_id)
        self.bodies.control[index] = self._controls[index] = control or stand_still

    def impair(self, robot_id: int, impairment: Impairment) -> None:
        """Impair a robot's vehicle from the next period on; `Impairment()` repairs it.

        It lasts until then, or until the robot gets another control.

        Raises:
            ValueError: there is no such robot, or a part is not between 0 and 1.
        """
        index = self.index(robot_id)
        control = self._controls[index]
        if impairment != Impairment():
            control = impaired(control, impairment, self.period_s, self.bodies.limits[index])
        self.bodies.control[index] = control

    def advance(self, until_s: float) -> None:
        """Run all periods that end by `until_s`; nothing if that is past.

        Raises:
            ValueError: the time is not finite.
        """
        if not isfinite(until_s):
            raise ValueError(f"until_s is {until_s}, allowed: finite")
        until = int(until_s / self.period_s + _ROUNDING)
        if until > self._period and not self._closed:
            self.engine.run(until)
            self._period = until
            self.now_s = until * self.period_s

    def close(self) -> None:
        """Free what the engine holds; the states and the truth stay readable. Idempotent."""
        if not self._closed:
            self._closed = True
            self.engine.close()
