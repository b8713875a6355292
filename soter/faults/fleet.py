"""A fleet with faults: it stands in front of any backend's fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from soter.clock import Clock
from soter.faults.fault import Fault
from soter.faults.kinds import FaultTable
from soter.faults.robot import FaultyRobot, widened
from soter.sdk import Capabilities, Fleet, Robot


@dataclass(frozen=True, slots=True)
class FaultReport:
    """What one fault did to one robot.

    Attributes:
        kind: its kind.
        robot_id: the robot.
        declared: whether the stack was told.
        affected: commands and samples that it spoilt, or times that it impaired the vehicle.
    """

    kind: str
    robot_id: int
    declared: bool
    affected: int


class FaultyClock(Clock):
    """A fleet's clock that delivers late commands at their time while it sleeps.

    Args:
        inner: the backend's clock.
    """

    def __init__(self, inner: Clock) -> None:
        self._inner: Final = inner
        self.robots: Sequence[FaultyRobot] = ()

    def now(self) -> float:
        return self._inner.now()

    def steady_s(self) -> float:
        return self._inner.steady_s()

    def sleep_until(self, time_s: float) -> None:
        while self.robots:
            due_s = min(robot.next_due_s for robot in self.robots)
            # What comes in at the very end is delivered too: it was due before whatever the caller does then.
            if due_s > time_s:
                break
            self._inner.sleep_until(due_s)
            for robot in self.robots:
                robot.deliver()
        self._inner.sleep_until(time_s)


class FaultyFleet(Fleet):
    """The robots of a backend behind their faults; robots without faults are what they were.

    Args:
        inner: the backend's fleet, of which no robot is ready yet.
        tables: the faults.
        seed: what is drawn, is drawn from it.
        tick_s: how often the state will be read.

    Raises:
        Unsupported: a fault needs what a robot does not offer; nothing has moved.
    """

    def __init__(self, inner: Fleet, tables: Sequence[FaultTable], seed: int, tick_s: float) -> None:
        self.inner: Final = inner
        clock = FaultyClock(inner.clock)
        robots: list[Robot] = []
        for robot in inner.robots:
            faults = [table.made_for(robot.id, seed, tick_s) for table in tables if table.hits(robot.id)]
            robots.append(_behind(robot, clock, faults) if faults else robot)
        super().__init__(clock, robots, inner.truth)
        self._faulty: Final = tuple(robot for robot in self.robots if isinstance(robot, FaultyRobot))
        clock.robots = self._faulty

    def report(self) -> tuple[FaultReport, ...]:
        """Return what every fault did up to now."""
        return tuple(
            FaultReport(fault.options.kind, robot.id, fault.options.declared, fault.affected)
            for robot in self._faulty
            for fault in robot.faults
        )

    def lost(self) -> str:
        return self.inner.lost()

    def _close(self) -> None:
        self.inner.close()


def _behind(robot: Robot, clock: Clock, faults: Sequence[Fault[Any]]) -> FaultyRobot:
    """Put a robot behind its faults: a class of its own, since what a class declares holds for all of its robots."""
    promise = widened(type(robot).declared, faults)

    class Declared(FaultyRobot):
        declared: ClassVar[Capabilities] = promise

    Declared.__name__ = Declared.__qualname__ = f"Faulty{type(robot).__name__}"
    return Declared(robot, clock, faults)
