"""A scripted robot behind faults, on a clock that only the test moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from soter.clock import VirtualClock
from soter.config import MissionFile
from soter.faults import FaultyFleet, FaultyRobot, read_faults
from soter.sdk import Fleet, RobotSpec, RobotState
from tests.sdk.fake import FakeRobot

TICK_S = 0.05


class FakeFleet(Fleet):
    """Scripted robots that share a clock."""

    def __init__(self, robots: Sequence[FakeRobot], clock: VirtualClock) -> None:
        super().__init__(clock, robots, None)
        self.closed = 0

    def _close(self) -> None:
        self.closed += 1


class ImpairableRobot(FakeRobot):
    """A scripted robot that notes how it is impaired."""

    impaired: tuple[float, float, float, bool] = (1.0, 1.0, 1.0, True)

    def impair(self, left: float, right: float, brake: float, alive: bool) -> None:
        self.impaired = (left, right, brake, alive)
        self._called("impair")


def mission(*tables: dict[str, Any]) -> MissionFile:
    return MissionFile(workspace=Path("room.xml"), fault=tables)


def fleet_of(*tables: dict[str, Any], robots: int = 1, seed: int = 0, kind: type[FakeRobot] = FakeRobot) -> FaultyFleet:
    """Put robots behind faults; they are not ready yet."""
    clock = VirtualClock()
    made = [kind(RobotSpec(number, 0.0, 0.0, 0.0), clock) for number in range(1, robots + 1)]
    ids = [robot.id for robot in made]
    return FaultyFleet(FakeFleet(made, clock), read_faults(mission(*tables), ids), seed, TICK_S)


class Bench:
    """One robot behind faults, ready at time 0.

    Attributes:
        fleet: the fleet.
        robot: in front of the faults.
        behind: the scripted robot behind them; its calls so far are forgotten.
    """

    def __init__(self, *tables: dict[str, Any], seed: int = 0, kind: type[FakeRobot] = FakeRobot) -> None:
        self.fleet = fleet_of(*tables, seed=seed, kind=kind)
        robot = self.fleet.robots[0]
        assert isinstance(robot, FaultyRobot)
        assert isinstance(robot.inner, FakeRobot)
        self.robot, self.behind = robot, robot.inner
        robot.init(1.0)
        self.behind.calls.clear()

    @property
    def now_s(self) -> float:
        return self.fleet.clock.now()

    def run(self, until_s: float) -> None:
        """Let time pass without looking."""
        self.fleet.clock.sleep_until(until_s)

    def look(self, at_s: float, **values: Any) -> RobotState:
        """Let time pass, let the robot put out a sample, and read what comes through."""
        self.run(at_s)
        self.behind.place(**values)
        return self.robot.read_state()

    def seen(self, ticks: int, v_m_s: float = 0.2) -> list[RobotState]:
        """Read at every tick what comes through of a robot that drives east."""
        return [self.look(tick * TICK_S, x_m=v_m_s * tick * TICK_S) for tick in range(1, ticks + 1)]
