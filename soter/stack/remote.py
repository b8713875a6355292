"""Remote proxies: of a robot agent, in its task planner's process; of a task planner, in its robot agents' process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from soter.machine import Event, Goto, Machine, MachineRef, Next, State, Stay
from soter.stack.events import Place, RobotJoined, TargetEnded, TargetOutcome, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.robot_agent import RobotAgent


@dataclass(frozen=True, slots=True)
class RemoteCame(Event):
    """The process of the machine behind this proxy has joined: for the first time, or after a restart."""


@dataclass(frozen=True, slots=True)
class RemoteJoined(Event):
    """From a remote task planner: tell a robot agent that another robot has joined; both by robot id."""

    robot_id: int
    other_id: int


@dataclass(frozen=True, slots=True)
class RemoteVisit(Event):
    """From a remote task planner: have a robot visit a target."""

    robot_id: int
    target: VisitTarget


@dataclass(frozen=True)
class RemoteKit:
    """The kit of the proxy of a robot agent in another process.

    Attributes:
        robot_id: the robot.
        tell: sends an event to the other process; dropped while that process has not joined.
        subscribe: sets the machine that receives the events from there.
    """

    robot_id: int
    tell: Callable[[Event], None]
    subscribe: Callable[[int, MachineRef], None]


class RemoteAgent(Machine):
    """The task planner's proxy of a remote robot agent; remembers what the agent was told.

    A process that restarts knows nothing: it is told again of the other robots, and given its target again.
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
    """Return the class of a robot's agent, or of its proxy. Both take `(kit, task planner)`."""
    return RemoteAgent if isinstance(kit, RemoteKit) else RobotAgent


@dataclass(frozen=True)
class RemoteTasks:
    """What a process with robots is given of a mission whose task planner is in another process.

    Attributes:
        kits: the kits of this process's robots.
        tell: sends an event to the task planner's process; dropped while that process has not joined.
        subscribe: sets the machine that receives the events from there.
        agents: references to the agents of other processes' robots, by robot.
        on_target: called with every target given: robot, target id, place.
        on_ended: called with every target that ended: robot, target id, outcome.
    """

    kits: Mapping[int, RobotKit]
    tell: Callable[[Event], None]
    subscribe: Callable[[MachineRef], None]
    agents: Mapping[int, MachineRef]
    on_target: Callable[[int, int, Place], None]
    on_ended: Callable[[int, int, TargetOutcome], None]


@dataclass
class _Errand:
    """The targets of one robot.

    Attributes:
        agent: its machine.
        given: the task planner's number of the agent's target; None if it has none, or one from before the task planner
            restarted.
        busy: whether the agent has a target.
        waiting: its next target.
    """

    agent: MachineRef
    given: int | None = None
    busy: bool = False
    waiting: RemoteVisit | None = None


class RemoteTaskPlanner(Machine):
    """The robot agents' proxy of a remote task planner; gives targets its own numbers, since the planner may restart.

    A robot finishes its target when the task planner is gone. A target from the restarted one waits until then.
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
