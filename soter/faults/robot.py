"""A robot with faults: wraps any backend's robot, and applies the faults to commands and samples."""

from __future__ import annotations

import heapq
import logging
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from soter.clock import Clock
from soter.config.tables import ReseedTable
from soter.errors import SoterError, Unsupported
from soter.faults.fault import ROUNDING_S, Call, Fault, Impairable, Impairment, Passage, SentCommand, widened
from soter.faults.kinds import FaultTable
from soter.sdk import Capabilities, Controller, FaultReport, Fleet, Goal, Link, Robot, RobotState

logger = logging.getLogger(__name__)

_WHOLE: Final = Impairment()


class FaultyRobot(Robot):
    """One robot behind its faults, with its promise widened by the declared ones.

    Commands pass the faults in the order of the tables; so do samples on their way back. The fleet's clock delivers
    late commands while it sleeps, and so exactly on time.

    Args:
        inner: the backend's robot, which belongs to this one from now on.
        clock: the clock of the faulty fleet.
        faults: its faults, in the order of the tables.
        reseeds: when the faults begin to draw from other seeds.
    """

    def __init__(
        self, inner: Robot, clock: Clock, faults: Sequence[Fault[Any]], reseeds: Sequence[ReseedTable] = ()
    ) -> None:
        super().__init__(replace(inner.spec, promised=widened(inner.declared, faults)), clock)
        self.stale_after_s, self.down_after_s = inner.stale_after_s, inner.down_after_s
        self.inner: Final = inner
        self.faults: Final = tuple(faults)
        self._reseeds: Final = deque(sorted(reseeds, key=lambda each: each.at_s))
        self._ready_s = math.inf
        self._queue: list[tuple[float, int, SentCommand]] = []
        self._queued = 0
        self._last_due_s = -math.inf
        self._goal_behind: Goal | None = None
        self._goal_sent: Goal | None = None
        self._impaired = _WHOLE
        self._late_failure: Exception | None = None
        self._vehicle = inner if isinstance(inner, Impairable) else None
        for fault in self.faults:
            if fault.needs_vehicle and self._vehicle is None:
                raise Unsupported(
                    f"robot {self.id}: a fault of kind '{fault.options.kind}' needs a vehicle that can be impaired, "
                    f"and a {type(inner).__name__} cannot; use a simulated backend in this process, such as kinematic"
                )

    # --- for the fleet's clock -------------------------------------------------------------------------------

    @property
    def next_due_s(self) -> float:
        """Fleet time at which the next late command arrives; infinite for none."""
        return self._queue[0][0] if self._queue else math.inf

    def deliver(self) -> None:
        """Deliver the commands whose time has come. A failure is raised at the next reading of the state."""
        now_s = self.clock.now()
        while self._queue and self._queue[0][0] <= now_s + ROUNDING_S:
            command = heapq.heappop(self._queue)[2]
            try:
                self._pass_on(command)
            except (SoterError, OSError, ValueError) as failure:
                logger.warning("robot %d: a late %s failed: %s", self.id, command.call.value, failure)
                self._late_failure = failure

    # --- the hooks -------------------------------------------------------------------------------------------

    def _connect(self, timeout_s: float) -> Capabilities:
        self.inner.init(timeout_s)
        # Faults begin when the robot is ready: by then a first sample has come through, as from any robot.
        sample: RobotState | None = self._read()
        for fault in self.faults:
            sample = fault.sample(0.0, False, sample)
        self._ready_s = self.clock.now()
        return widened(self.inner.capabilities, self.faults)

    def _send_goto(self, goal: Goal) -> None:
        self._send(SentCommand(Call.GOTO, goal, goal.target))

    def _hand_over(self, to: Controller) -> None:
        self._send(SentCommand(Call.SWITCH, to=to))

    def _renew_lease(self) -> None:
        self._send(SentCommand(Call.RENEW))

    def _halt(self) -> None:
        self._send(SentCommand(Call.HALT))

    def _sample(self) -> RobotState | None:
        self._reseed()
        self._impair()
        self.deliver()
        if self._late_failure is not None:
            failure, self._late_failure = self._late_failure, None
            raise failure
        time_s = self.clock.now() - self._ready_s
        sample: RobotState | None = self._read()
        for fault in self.faults:
            sample = fault.sample(time_s, fault.options.active(time_s), sample)
        return sample

    def _disconnect(self, timeout_s: float) -> None:
        self._queue.clear()
        if self._vehicle is not None and self._impaired != _WHOLE:
            self._vehicle.impair(*_WHOLE)
        self.inner.close(timeout_s)

    def _send(self, command: SentCommand) -> None:
        self._reseed()
        now_s = self.clock.now()
        time_s = now_s - self._ready_s
        passages = [Passage(command)]
        for fault in self.faults:
            if fault.options.active(time_s):
                passages = [
                    Passage(out.command, before.delay_s + out.delay_s, before.overtakes or out.overtakes)
                    for before in passages
                    for out in fault.command(time_s, before.command)
                ]
        for passage in passages:
            due_s = now_s + passage.delay_s
            if not passage.overtakes:
                due_s = self._last_due_s = max(due_s, self._last_due_s)
            if due_s <= now_s + ROUNDING_S and not self._queue:
                self._pass_on(passage.command)
            else:
                self._queued += 1
                heapq.heappush(self._queue, (due_s, self._queued, passage.command))

    def _pass_on(self, command: SentCommand) -> None:
        inner = self.inner
        if command.call is Call.RENEW:
            inner.renew_lease()
        elif command.call is Call.SWITCH and command.to is not None:
            inner.switch_ac_sc(command.to, "passed on")
        elif command.call is Call.HALT:
            if self._goal_behind is not None:
                self._goal_behind.cancel()
        elif command.goal is not None and command.target is not None:
            self._goal_behind = inner.goto(command.target, command.goal.by)
            self._goal_sent = command.goal

    def _reseed(self) -> None:
        """Seed the faults' random numbers anew if it is time to."""
        while self._reseeds and self._reseeds[0].at_s <= self.clock.now() + ROUNDING_S:
            seed = self._reseeds.popleft().seed
            for index, fault in enumerate(self.faults):
                fault.context.random.seed(f"fault {index}, robot {self.id}, reseed {seed}")

    def _read(self) -> RobotState:
        """Return the inner robot's sample, with this robot's number of the present goal."""
        sample = self.inner.read_state()
        goal_id = None
        if sample.goal_id is not None:
            behind, sent = self._goal_behind, self._goal_sent
            if behind is not None and sent is not None and sample.goal_id == behind.id:
                goal_id = sent.id
        if goal_id == sample.goal_id and sample.link is Link.UP:
            return sample
        return sample._replace(goal_id=goal_id, link=Link.UP)

    def _impair(self) -> None:
        """Impair the vehicle by the faults that are on now."""
        if self._vehicle is None:
            return
        time_s = self.clock.now() - self._ready_s
        wanted = _WHOLE
        for fault in self.faults:
            if fault.options.active(time_s):
                wanted = wanted.joined(fault.impairment() or _WHOLE)
        if wanted == self._impaired:
            return
        for fault in self.faults:
            fault.affected += fault.needs_vehicle and fault.options.active(time_s)
        came_back = wanted.alive and not self._impaired.alive
        if not wanted.alive:
            self._queue.clear()
        self._impaired = wanted
        self._vehicle.impair(*wanted)
        if came_back:
            # As an adapter does when its robot is back: the robot has forgotten its controller.
            self._pass_on(SentCommand(Call.SWITCH, to=Controller.SC))
            self._send(SentCommand(Call.SWITCH, to=self.in_charge))


class FaultyClock(Clock):
    """A fleet's clock that delivers late commands at their time while it sleeps."""

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
            # Commands due exactly at the end are delivered too, before the caller goes on.
            if due_s > time_s:
                break
            self._inner.sleep_until(due_s)
            for robot in self.robots:
                robot.deliver()
        self._inner.sleep_until(time_s)


class FaultyFleet(Fleet):
    """The robots of a backend behind their faults; robots without faults are not changed.

    Args:
        inner: the backend's fleet, of which no robot is ready yet.
        tables: the faults.
        seed: the seed of the faults' random numbers.
        tick_s: time between two readings of the state.
        reseeds: when the faults begin to draw from other seeds.

    Raises:
        Unsupported: a fault needs a vehicle that can be impaired; nothing has moved.
    """

    def __init__(
        self,
        inner: Fleet,
        tables: Sequence[FaultTable],
        seed: int,
        tick_s: float,
        reseeds: Sequence[ReseedTable] = (),
    ) -> None:
        self.inner: Final = inner
        clock = FaultyClock(inner.clock)
        robots: list[Robot] = []
        for robot in inner.robots:
            faults = [table.made_for(robot.id, seed, tick_s) for table in tables if table.hits(robot.id)]
            robots.append(FaultyRobot(robot, clock, faults, reseeds) if faults else robot)
        super().__init__(clock, robots, inner.truth)
        self._faulty: Final = tuple(robot for robot in self.robots if isinstance(robot, FaultyRobot))
        clock.robots = self._faulty

    def injected(self) -> tuple[FaultReport, ...]:
        return tuple(
            FaultReport(fault.options.kind, robot.id, fault.options.declared, fault.affected)
            for robot in self._faulty
            for fault in robot.faults
        )

    def lost(self) -> str:
        return self.inner.lost()

    def _close(self) -> None:
        self.inner.close()
