"""The motion planner machine: asks the planner for a path and has it executed. Untrusted."""

from __future__ import annotations

import math

from soter.machine import Goto, Machine, MachineRef, Next, State, Stay
from soter.stack.events import (
    AbandonPath,
    ExecutePath,
    PathCompleted,
    PathFailed,
    PathPlanned,
    PlanAndGo,
)
from soter.stack.kit import RobotKit
from soter.stack.plan_executor import PlanExecutor
from soter.stack.planners import PlanRequest

PEER_NEAR_M = 1.5
"""Peers without control within this distance are planned around."""


class MotionPlanner(Machine):
    """One request at a time; a newer one takes the place of an older one."""

    Starting: State[RobotKit] = State(start=True)
    Waiting: State[None] = State(ignore=(PathPlanned, PathCompleted, PathFailed))
    Planning: State[PlanAndGo] = State(ignore=(PathCompleted, PathFailed))
    Executing: State[PathPlanned] = State(ignore=(PathPlanned,))

    kit: RobotKit
    executor: MachineRef
    request: PlanAndGo
    planned: PathPlanned

    @Starting.entry
    def _start(self, kit: RobotKit) -> Next:
        self.kit = kit
        kit.subscribe(kit.robot_id, self.ref, ())
        self.executor = self.create(PlanExecutor, kit, name=f"PlanExecutor {kit.robot_id}")
        return Goto(self.Waiting)

    @Waiting.on(PlanAndGo)
    @Planning.on(PlanAndGo)
    def _accept(self, e: PlanAndGo) -> Next:
        return Goto(self.Planning, e)

    @Executing.on(PlanAndGo)
    def _replace(self, e: PlanAndGo) -> Next:
        self.send(self.executor, AbandonPath(e.request_id))
        return Goto(self.Planning, e)

    @Planning.entry
    def _plan(self, e: PlanAndGo) -> Next:
        self.request = e
        state = self.kit.port.state
        if state is None:
            self.send(e.reply_to, PathFailed(e.request_id, "the robot's state is not known"))
            return Goto(self.Waiting)
        start = (state.x_m, state.y_m)
        discs = tuple(
            (peer.state.x_m, peer.state.y_m, self.kit.disc_m)
            for peer in self.kit.peers.values()
            if not peer.engaged
            and peer.state is not None
            and math.hypot(peer.state.x_m - start[0], peer.state.y_m - start[1]) < PEER_NEAR_M
        )
        self.kit.submit(PlanRequest(e.request_id, self.kit.robot_id, start, e.place, discs, self.kit.seed), self.ref)
        return Stay()

    @Planning.on(PathPlanned)
    def _planned(self, e: PathPlanned) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        if e.reason is not None:
            self.send(self.request.reply_to, PathFailed(e.request_id, e.reason))
            return Goto(self.Waiting)
        return Goto(self.Executing, e)

    @Executing.entry
    def _execute(self, e: PathPlanned) -> Next:
        self.planned = e
        self.send(self.executor, ExecutePath(e.request_id, e.path, self.request.timeout_s, self.ref))
        return Stay()

    @Executing.on(PathCompleted)
    def _completed(self, e: PathCompleted) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        self.send(self.request.reply_to, PathCompleted(e.request_id, self.planned.reaches_goal))
        return Goto(self.Waiting)

    @Executing.on(PathFailed)
    def _failed(self, e: PathFailed) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        self.send(self.request.reply_to, e)
        return Goto(self.Waiting)

    @Waiting.on(AbandonPath)
    @Planning.on(AbandonPath)
    @Executing.on(AbandonPath)
    def _abandon(self, e: AbandonPath) -> Next:
        self.send(self.executor, e)
        return Goto(self.Waiting)
