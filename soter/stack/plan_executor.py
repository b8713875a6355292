"""The plan executor: drives a path waypoint by waypoint through the AC's port. Untrusted, like all of the AC."""

from __future__ import annotations

from functools import partial

from soter.machine import Goto, Machine, Next, State
from soter.sdk import GoalStatus, Waypoint
from soter.stack.events import AbandonPath, Disengaged, ExecutePath, GoalEnded, PathCompleted, PathFailed
from soter.stack.kit import RobotKit


class PlanExecutor(Machine):
    """Waits for a path, executes it, reports how that ended; dropped at once when the AC loses control."""

    Starting: State[RobotKit] = State(start=True)
    Waiting: State[None] = State(ignore=(GoalEnded, Disengaged, AbandonPath))
    Executing: State[ExecutePath] = State(defer=(ExecutePath,), ignore=(GoalEnded,))

    kit: RobotKit

    @Starting.entry
    def _start(self, kit: RobotKit) -> Next:
        self.kit = kit
        kit.subscribe(kit.robot_id, self.ref, (GoalEnded, Disengaged))
        return Goto(self.Waiting)

    @Waiting.on(ExecutePath)
    def _accept(self, e: ExecutePath) -> Next:
        return Goto(self.Executing, e)

    @Executing.entry
    async def _execute(self, e: ExecutePath) -> Next:
        waypoints = [Waypoint(x, y, radius_m=self.kit.arrival_radius_m, timeout_s=e.timeout_s) for x, y in e.path]
        for index, waypoint in enumerate(waypoints):
            goal_id = self.kit.port.goto(waypoint, tuple(waypoints[index + 1 :]))
            ended = await self.receive(GoalEnded, match=partial(_is_of, goal_id))
            if ended.status != GoalStatus.REACHED.value:
                self.send(e.reply_to, PathFailed(e.request_id, ended.status))
                return Goto(self.Waiting)
        self.send(e.reply_to, PathCompleted(e.request_id))
        return Goto(self.Waiting)

    @Executing.interrupt(Disengaged)
    def _dropped(self, e: Disengaged) -> Next:
        """The supervisor has ended the goal already; the robot agent hears of it from the port itself."""
        return Goto(self.Waiting)

    @Executing.interrupt(AbandonPath)
    def _abandoned(self, e: AbandonPath) -> Next:
        return Goto(self.Waiting)


def _is_of(goal_id: int, ended: GoalEnded) -> bool:
    return ended.goal_id == goal_id
