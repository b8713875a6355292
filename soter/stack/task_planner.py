"""The task planner: creates a robot agent for every robot, tells them of each other, and keeps each of them busy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from soter.machine import Goto, Machine, MachineRef, Next, State, Stay
from soter.stack.away import AwayAgent, AwayKit
from soter.stack.events import Outcome, Place, RobotJoined, TargetEnded, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.robot_agent import RobotAgent


@dataclass(frozen=True)
class Tasks:
    """What the task planner plans.

    Attributes:
        kits: of every robot: those of this process with all that their machines need, those of others without.
        next_target: where a robot goes next; called with its id.
        on_target: told of every target given: robot, target id, place.
        on_ended: told of every target that ended: robot, target id, outcome.
    """

    kits: Mapping[int, RobotKit | AwayKit]
    next_target: Callable[[int], Place]
    on_target: Callable[[int, int, Place], None]
    on_ended: Callable[[int, int, Outcome], None]


class TaskPlanner(Machine):
    """Surveillance for ever: whoever is done with a target gets the next one."""

    Starting: State[Tasks] = State(start=True)
    Running: State[None] = State()

    tasks: Tasks

    @Starting.entry
    def _start(self, tasks: Tasks) -> Next:
        self.tasks = tasks
        self.last_target_id = 0
        self.agents: dict[int, MachineRef] = {}
        for robot_id, kit in tasks.kits.items():
            machine = AwayAgent if isinstance(kit, AwayKit) else RobotAgent
            agent = self.create(machine, (kit, self.ref), name=f"RobotAgent {robot_id}")
            for other_id, other in self.agents.items():
                self.send(other, RobotJoined(robot_id, agent))
                self.send(agent, RobotJoined(other_id, other))
            self.agents[robot_id] = agent
        for robot_id in self.agents:
            self._assign(robot_id)
        return Goto(self.Running)

    @Running.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        self.tasks.on_ended(e.robot_id, e.target_id, e.outcome)
        self._assign(e.robot_id)
        return Stay()

    def _assign(self, robot_id: int) -> None:
        self.last_target_id += 1
        place = self.tasks.next_target(robot_id)
        self.tasks.on_target(robot_id, self.last_target_id, place)
        self.send(self.agents[robot_id], VisitTarget(self.last_target_id, place))
