"""What stands, in one process, for machines of another: a robot agent away from its task planner, and the reverse."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from soter.machine import Event, Goto, Machine, MachineRef, Next, State, Stay
from soter.stack.events import Place, RobotJoined, TargetEnded, TargetOutcome, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.robot_agent import RobotAgent


@dataclass(frozen=True, slots=True)
class RemoteCame(Event):
    """The process of the machine that this one stands for is there: for the first time, or after a new start."""


@dataclass(frozen=True, slots=True)
class RemoteJoined(Event):
    """From a task planner elsewhere: a robot agent is to be told of another, by the numbers of their robots."""

    robot_id: int
    other_id: int


@dataclass(frozen=True, slots=True)
class RemoteVisit(Event):
    """From a task planner elsewhere: a robot is to go there."""

    robot_id: int
    target: VisitTarget


@dataclass(frozen=True)
class RemoteKit:
    """What stands for a robot whose agent is in another process.

    Attributes:
        robot_id: which robot.
        tell: sends an event to the other process; dropped while that has not come.
        subscribe: names the machine that is to be told of what comes from there.
    """

    robot_id: int
    tell: Callable[[Event], None]
    subscribe: Callable[[int, MachineRef], None]


class RemoteAgent(Machine):
    """Stands beside the task planner for a robot agent elsewhere, and remembers what that was told.

    A process that starts anew knows nothing: it is told again who else there is, and given its target again.
    """

    Starting: State[tuple[RemoteKit, MachineRef]] = State(start=True)
    Standing: State[None] = State()

    kit: RemoteKit
    task_planner: MachineRef

    @Starting.entry
    def _start(self, given: tuple[RemoteKit, MachineRef]) -> Next:
        self.kit, self.task_planner = given
        self.others: list[int] = []
        self.target: VisitTarget | None = None
        self.kit.subscribe(self.kit.robot_id, self.ref)
        return Goto(self.Standing)

    @Standing.on(RemoteCame)
    def _came(self, e: RemoteCame) -> Next:
        for other_id in self.others:
            self._tell_of(other_id)
        if self.target is not None:
            self._give(self.target)
        return Stay()

    @Standing.on(RobotJoined)
    def _joined(self, e: RobotJoined) -> Next:
        self.others.append(e.robot_id)
        self._tell_of(e.robot_id)
        return Stay()

    @Standing.on(VisitTarget)
    def _visit(self, e: VisitTarget) -> Next:
        self.target = e
        self._give(e)
        return Stay()

    @Standing.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        if self.target is not None and e.target_id == self.target.target_id:
            self.target = None
            self.send(self.task_planner, e)
        return Stay()

    def _tell_of(self, other_id: int) -> None:
        self.kit.tell(RemoteJoined(self.kit.robot_id, other_id))

    def _give(self, target: VisitTarget) -> None:
        self.kit.tell(RemoteVisit(self.kit.robot_id, target))


def robot_agent(kit: RobotKit | RemoteKit) -> type[Machine]:
    """Return the class of a robot's agent, or of what stands for it. Both take `(kit, who is told)`."""
    return RemoteAgent if isinstance(kit, RemoteKit) else RobotAgent


@dataclass(frozen=True)
class RemoteTasks:
    """What a process with robots knows of a mission whose task planner is in another.

    Attributes:
        kits: of the robots of this process.
        tell: sends an event to the task planner's process; dropped while that has not come.
        subscribe: names the machine that is to be told of what comes from there.
        agents: names the agents of other processes' robots, by robot.
        on_target: told of every target given: robot, target id, place.
        on_ended: told of every target that ended: robot, target id, outcome.
    """

    kits: Mapping[int, RobotKit]
    tell: Callable[[Event], None]
    subscribe: Callable[[MachineRef], None]
    agents: Mapping[int, MachineRef]
    on_target: Callable[[int, int, Place], None]
    on_ended: Callable[[int, int, TargetOutcome], None]


@dataclass
class _Errand:
    """What one robot is after.

    Attributes:
        agent: its machine.
        given: the task planner's number of the target that the agent has; None while it has none, or has one of a
            task planner that is no more.
        busy: whether the agent has a target.
        waiting: what it is to have next.
    """

    agent: MachineRef
    given: int | None = None
    busy: bool = False
    waiting: RemoteVisit | None = None


class RemoteTaskPlanner(Machine):
    """Stands beside robot agents for a task planner elsewhere, and numbers targets anew: that one may start anew too.

    What a robot is after when the task planner goes, it finishes. What it is given by a new one waits until then.
    """

    Starting: State[RemoteTasks] = State(start=True)
    Standing: State[None] = State()

    tasks: RemoteTasks

    @Starting.entry
    def _start(self, tasks: RemoteTasks) -> Next:
        self.tasks = tasks
        self.last_target_id = 0
        self.errands = {
            robot_id: _Errand(self.create(RobotAgent, (kit, self.ref), name=f"RobotAgent {robot_id}"))
            for robot_id, kit in tasks.kits.items()
        }
        tasks.subscribe(self.ref)
        return Goto(self.Standing)

    @Standing.on(RemoteCame)
    def _came(self, e: RemoteCame) -> Next:
        for errand in self.errands.values():
            errand.given = errand.waiting = None
        return Stay()

    @Standing.on(RemoteJoined)
    def _joined(self, e: RemoteJoined) -> Next:
        errand, here = self.errands.get(e.robot_id), self.errands.get(e.other_id)
        other = here.agent if here is not None else self.tasks.agents.get(e.other_id)
        if errand is not None and other is not None:
            self.send(errand.agent, RobotJoined(e.other_id, other))
        return Stay()

    @Standing.on(RemoteVisit)
    def _visit(self, e: RemoteVisit) -> Next:
        errand = self.errands.get(e.robot_id)
        if errand is None:
            return Stay()
        if errand.busy:
            errand.waiting = e
        else:
            self._give(errand, e)
        return Stay()

    @Standing.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        errand = self.errands[e.robot_id]
        self.tasks.on_ended(e.robot_id, e.target_id, e.outcome)
        if errand.given is not None:
            self.tasks.tell(replace(e, target_id=errand.given))
        errand.given, errand.busy = None, False
        waiting, errand.waiting = errand.waiting, None
        if waiting is not None:
            self._give(errand, waiting)
        return Stay()

    def _give(self, errand: _Errand, e: RemoteVisit) -> None:
        self.last_target_id += 1
        errand.given, errand.busy = e.target.target_id, True
        self.tasks.on_target(e.robot_id, self.last_target_id, e.target.place)
        self.send(errand.agent, replace(e.target, target_id=self.last_target_id))
