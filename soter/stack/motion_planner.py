"""Two machines: one requests paths from the planner, one drives them through the AC's port. Untrusted."""

from __future__ import annotations

import math
from functools import partial

from soter.machine import Goto, Machine, MachineRef, Next, State, Stay
from soter.sdk import GoalStatus, Waypoint
from soter.stack import events
from soter.stack.encounters import AHEAD_S, stands
from soter.stack.kit import RobotKit
from soter.stack.planners import PlanRequest


class PlanExecutor(Machine):
    """Waits for a path, executes it, and reports how it ended; drops it at once when the AC loses control."""

    Starting: State[RobotKit] = State(start=True)
    Waiting: State[None] = State(ignore=(events.GoalEnded, events.Disengaged, events.AbandonPath))
    Executing: State[events.ExecutePath] = State(defer=(events.ExecutePath,), ignore=(events.GoalEnded,))

    kit: RobotKit

    @Starting.entry
    def _start(self, kit: RobotKit) -> Next:
        self.kit = kit
        kit.subscribe(kit.robot_id, self.ref, (events.GoalEnded, events.Disengaged))
        return Goto(self.Waiting)

    @Waiting.on(events.ExecutePath)
    def _accept(self, e: events.ExecutePath) -> Next:
        return Goto(self.Executing, e)

    @Executing.entry
    async def _execute(self, e: events.ExecutePath) -> Next:
        waypoints = [Waypoint(x, y, radius_m=self.kit.arrival_radius_m, timeout_s=e.timeout_s) for x, y in e.path]
        for index, waypoint in enumerate(waypoints):
            goal_id = self.kit.port.goto(waypoint, tuple(waypoints[index + 1 :]))
            ended = await self.receive(events.GoalEnded, match=partial(_is_of, goal_id))
            if ended.status != GoalStatus.REACHED.value:
                self.send(e.reply_to, events.PathFailed(e.request_id, ended.status))
                return Goto(self.Waiting)
        self.send(e.reply_to, events.PathCompleted(e.request_id))
        return Goto(self.Waiting)

    @Executing.interrupt(events.Disengaged)
    def _dropped(self, e: events.Disengaged) -> Next:
        """Drop the path. The supervisor has already ended the goal, and the port tells the robot agent itself."""
        return Goto(self.Waiting)

    @Executing.interrupt(events.AbandonPath)
    def _abandoned(self, e: events.AbandonPath) -> Next:
        return Goto(self.Waiting)


def _is_of(goal_id: int, ended: events.GoalEnded) -> bool:
    return ended.goal_id == goal_id


PEER_NEAR_M = 1.5
"""Standing peers within this distance, or within the robot's look-ahead, are planned around."""


class MotionPlanner(Machine):
    """Handles one request at a time; a newer one replaces an older one."""

    Starting: State[RobotKit] = State(start=True)
    Waiting: State[None] = State(ignore=(events.PathPlanned, events.PathCompleted, events.PathFailed))
    Planning: State[events.PlanAndGo] = State(ignore=(events.PathCompleted, events.PathFailed))
    Executing: State[events.PathPlanned] = State(ignore=(events.PathPlanned,))

    kit: RobotKit
    executor: MachineRef
    request: events.PlanAndGo
    planned: events.PathPlanned

    @Starting.entry
    def _start(self, kit: RobotKit) -> Next:
        self.kit = kit
        kit.subscribe(kit.robot_id, self.ref, ())
        self.executor = self.create(PlanExecutor, kit, name=f"PlanExecutor {kit.robot_id}")
        return Goto(self.Waiting)

    @Waiting.on(events.PlanAndGo)
    @Planning.on(events.PlanAndGo)
    def _accept(self, e: events.PlanAndGo) -> Next:
        return Goto(self.Planning, e)

    @Executing.on(events.PlanAndGo)
    def _replace(self, e: events.PlanAndGo) -> Next:
        self.send(self.executor, events.AbandonPath(e.request_id))
        return Goto(self.Planning, e)

    @Planning.entry
    def _plan(self, e: events.PlanAndGo) -> Next:
        self.request = e
        state = self.kit.port.state
        if state is None:
            self.send(e.reply_to, events.PathFailed(e.request_id, "the robot's state is not known"))
            return Goto(self.Waiting)
        start = (state.x_m, state.y_m)
        discs = tuple(
            (peer.state.x_m, peer.state.y_m, self.kit.disc_m)
            for peer in self.kit.peers.values()
            if peer.state is not None
            and stands(self.kit, peer)
            and math.hypot(peer.state.x_m - start[0], peer.state.y_m - start[1])
            < max(PEER_NEAR_M, self.kit.disc_m + AHEAD_S * self.kit.promised.v_max_m_s)
        )
        self.kit.submit(PlanRequest(e.request_id, self.kit.robot_id, start, e.place, discs, self.kit.seed), self.ref)
        return Stay()

    @Planning.on(events.PathPlanned)
    def _planned(self, e: events.PathPlanned) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        if e.reason is not None:
            self.send(self.request.reply_to, events.PathFailed(e.request_id, e.reason))
            return Goto(self.Waiting)
        return Goto(self.Executing, e)

    @Executing.entry
    def _execute(self, e: events.PathPlanned) -> Next:
        self.planned = e
        self.send(self.executor, events.ExecutePath(e.request_id, e.path, self.request.timeout_s, self.ref))
        return Stay()

    @Executing.on(events.PathCompleted)
    def _completed(self, e: events.PathCompleted) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        self.send(self.request.reply_to, events.PathCompleted(e.request_id, self.planned.reaches_goal))
        return Goto(self.Waiting)

    @Executing.on(events.PathFailed)
    def _failed(self, e: events.PathFailed) -> Next:
        if e.request_id != self.request.request_id:
            return Stay()
        self.send(self.request.reply_to, e)
        return Goto(self.Waiting)

    @Waiting.on(events.AbandonPath)
    @Planning.on(events.AbandonPath)
    @Executing.on(events.AbandonPath)
    def _abandon(self, e: events.AbandonPath) -> Next:
        self.send(self.executor, e)
        return Goto(self.Waiting)
