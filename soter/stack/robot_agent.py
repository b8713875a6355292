"""The robot agent: one robot of the mission. Takes targets one at a time and reports how each ended."""

from __future__ import annotations

from math import hypot
from typing import Final

from soter.machine import Goto, Machine, MachineRef, Next, State, Stay, Timer
from soter.sdk import RobotState, Waypoint
from soter.stack import events
from soter.stack.encounters import LOOK_S, Duty, duty, has_to_wait, looks_again_s
from soter.stack.kit import RobotKit
from soter.stack.motion_planner import MotionPlanner

RETRY_S: Final = 1.0
SET_OFF_S: Final = 0.5
"""A robot that set off less than this ago has no velocity yet that shows where it goes."""

REQUESTS_PER_ROBOT: Final = 1_000_000
"""Most requests of one robot; keeps the numbers of all robots' requests distinct."""

UNSAFE_MODULES: Final = frozenset({"geofence", "obstacle"})
"""A target is unsafe if one of these modules took control on the way; after other modules it is tried again."""


class RobotAgent(Machine):
    """Visits targets. The clock of a target stands still while the AC has no control."""

    Starting: State[tuple[RobotKit, MachineRef]] = State(start=True)
    Idle: State[None] = State(ignore=(events.PathCompleted, events.PathFailed, events.TargetTimeout, events.TryAgain))
    Visiting: State[events.VisitTarget] = State()

    kit: RobotKit
    task_planner: MachineRef
    motion_planner: MachineRef
    target: events.VisitTarget

    @Starting.entry
    def _start(self, given: tuple[RobotKit, MachineRef]) -> Next:
        self.kit, self.task_planner = given
        self.kit.subscribe(self.kit.robot_id, self.ref, (events.Disengaged, events.Reengaged))
        self.others: dict[int, MachineRef] = {}
        self.engaged = False
        self.request_id = self.kit.robot_id * REQUESTS_PER_ROBOT
        self.timeout_s = self.left_s = 0.0
        self.tries = 0
        self.running_since_s = 0.0
        self.waits = False
        self.timer: Timer | None = None
        self.motion_planner = self.create(MotionPlanner, self.kit, name=f"MotionPlanner {self.kit.robot_id}")
        self.after(LOOK_S, events.LookAbout())
        return Goto(self.Idle)

    @Idle.on(events.LookAbout)
    def _look_idly(self, e: events.LookAbout) -> Next:
        self._look_later(e)
        return Stay()

    @Visiting.on(events.LookAbout)
    def _look(self, e: events.LookAbout) -> Next:
        own = self._look_later(e)
        # Without a running timer the robot does not drive.
        if self.timer is None or own is None:
            return Stay()
        if self.waits:
            if not has_to_wait(self.kit, own):
                self._go()
            return Stay()
        owed = duty(self.kit, own) if self.now() - self.running_since_s > SET_OFF_S else Duty.NONE
        if owed is Duty.WAIT:
            self._wait(own)
        elif owed is Duty.GO_ROUND:
            self._go()
        return Stay()

    @Idle.on(events.RobotJoined)
    @Visiting.on(events.RobotJoined)
    def _joined(self, e: events.RobotJoined) -> Next:
        self.others[e.robot_id] = e.agent
        return Stay()

    @Idle.on(events.VisitTarget)
    def _accept(self, e: events.VisitTarget) -> Next:
        return Goto(self.Visiting, e)

    @Idle.on(events.Disengaged)
    def _lost_idle(self, e: events.Disengaged) -> Next:
        self.engaged = False
        return Stay()

    @Idle.on(events.Reengaged)
    def _regained_idle(self, e: events.Reengaged) -> Next:
        self.engaged = True
        return Stay()

    @Visiting.entry
    def _visit(self, e: events.VisitTarget) -> Next:
        self.target = e
        self.tries = 0
        self.timeout_s = self.kit.target_timeout_s if e.timeout_s is None else e.timeout_s
        self.left_s = self.timeout_s
        if self.engaged:
            self._go()
        return Stay()

    @Visiting.on(events.Reengaged)
    def _regained(self, e: events.Reengaged) -> Next:
        self.engaged = True
        self._go()
        return Stay()

    @Visiting.on(events.Disengaged)
    def _lost(self, e: events.Disengaged) -> Next:
        self.engaged = False
        self._stop_clock()
        self.waits = False
        self.send(self.motion_planner, events.AbandonPath(self.request_id))
        if e.module in UNSAFE_MODULES:
            return self._end(events.TargetOutcome.UNSAFE, e.module, e.cause)
        return self._count_failure(e.module, e.cause)

    @Visiting.on(events.PathCompleted)
    def _completed(self, e: events.PathCompleted) -> Next:
        if e.request_id != self.request_id:
            return Stay()
        if e.at_target:
            return self._end(events.TargetOutcome.REACHED)
        return self._retry("the path ends short of it")

    @Visiting.on(events.PathFailed)
    def _failed(self, e: events.PathFailed) -> Next:
        return self._retry(e.reason) if e.request_id == self.request_id else Stay()

    @Visiting.on(events.TryAgain)
    def _try_again(self, e: events.TryAgain) -> Next:
        if e.target_id == self.target.target_id and self.engaged and self.timer is None:
            self._go()
        return Stay()

    @Visiting.on(events.TargetTimeout)
    def _timed_out(self, e: events.TargetTimeout) -> Next:
        if e.target_id != self.target.target_id:
            return Stay()
        self.send(self.motion_planner, events.AbandonPath(self.request_id))
        return self._end(events.TargetOutcome.TIMED_OUT)

    def _look_later(self, e: events.LookAbout) -> RobotState | None:
        """Set the time of the next look; return the robot's state."""
        own = self.kit.port.state
        self.after(LOOK_S if self.waits or own is None else looks_again_s(self.kit, own), e)
        return own

    def _wait(self, own: RobotState) -> None:
        """Stop, and stand until the others are past. The target's time goes on."""
        self.waits = True
        self.send(self.motion_planner, events.AbandonPath(self.request_id))
        braking_s = hypot(own.vx_m_s, own.vy_m_s) / (2.0 * self.kit.promised.brake_m_s2)
        x_m, y_m = own.x_m + braking_s * own.vx_m_s, own.y_m + braking_s * own.vy_m_s
        self.kit.port.goto(Waypoint(x_m, y_m, radius_m=self.kit.arrival_radius_m))

    def _go(self) -> None:
        self._stop_clock()
        self.waits = False
        self.request_id += 1
        self.running_since_s = self.now()
        self.timer = self.after(self.left_s, events.TargetTimeout(self.target.target_id))
        self.send(self.motion_planner, events.PlanAndGo(self.request_id, self.target.place, self.timeout_s, self.ref))

    def _retry(self, reason: str) -> Next:
        """Count a failed path, and try another one a little later, when the other robots may have moved."""
        self._stop_clock()
        ended = self._count_failure("", reason)
        if isinstance(ended, Stay):
            self.after(RETRY_S, events.TryAgain(self.target.target_id))
        return ended

    def _count_failure(self, module: str, reason: str) -> Next:
        self.tries += 1
        return self._end(events.TargetOutcome.BLOCKED, module, reason) if self.tries >= self.target.tries else Stay()

    def _stop_clock(self) -> None:
        if self.timer is not None:
            # The timer may already be overdue by part of a tick, if something else was delivered before it.
            self.left_s = max(0.0, self.left_s - (self.now() - self.running_since_s))
            self.timer.cancel()
            self.timer = None

    def _end(self, outcome: events.TargetOutcome, module: str = "", reason: str = "") -> Next:
        self._stop_clock()
        ended = events.TargetEnded(self.kit.robot_id, self.target.target_id, outcome, module, reason)
        self.send(self.task_planner, ended)
        return Goto(self.Idle)
