"""Machines that stand for those of other processes, with the other process played by the test."""

from __future__ import annotations

from soter.machine import Event, Machine, MachineRef, Next, Runtime, State, Stay
from soter.missions.surveillance import TaskPlanner, Tasks
from soter.stack.events import Disengaged, Reengaged, RobotJoined, TargetEnded, TargetOutcome, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.remote import (
    RemoteAgent,
    RemoteCame,
    RemoteJoined,
    RemoteKit,
    RemoteTaskPlanner,
    RemoteTasks,
    RemoteVisit,
)
from tests.sdk.fake import CAPABILITIES
from tests.stack.test_machines import Mission

PLACE = (1.0, 2.0)


class Receiver(Machine):
    """Keeps what it is sent."""

    Waiting: State[None] = State(start=True)
    heard: list[Event]

    def __init__(self, heard: list[Event]) -> None:
        self.heard = heard

    @Waiting.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        self.heard.append(e)
        return Stay()


class Beside:
    """What stands beside a task planner for robot 2, and what it says to the other process.

    Attributes:
        told: to the other process.
        heard: by the task planner.
    """

    def __init__(self) -> None:
        self.told: list[Event] = []
        self.heard: list[Event] = []
        self.runtime = Runtime()
        self.task_planner = self.runtime.create(Receiver, heard=self.heard)
        kit = RemoteKit(2, self.told.append, lambda robot_id, machine: None)
        self.agent = self.runtime.create(RemoteAgent, (kit, self.task_planner))
        self.runtime.run()

    def post(self, *events: Event) -> list[Event]:
        """Send events, and return what is said to the other process."""
        self.told.clear()
        for event in events:
            self.runtime.post(self.agent, event)
        self.runtime.run()
        return [*self.told]


def test_a_start_of_the_other_process_is_told_everything_again() -> None:
    beside = Beside()
    assert beside.post(RobotJoined(1, beside.agent)) == [RemoteJoined(2, 1)]
    assert beside.post(VisitTarget(5, PLACE)) == [RemoteVisit(2, VisitTarget(5, PLACE))]
    assert beside.post(RemoteCame()) == [RemoteJoined(2, 1), RemoteVisit(2, VisitTarget(5, PLACE))]
    assert beside.post(TargetEnded(2, 5, TargetOutcome.REACHED)) == []
    assert beside.heard == [TargetEnded(2, 5, TargetOutcome.REACHED)]
    assert beside.post(RemoteCame()) == [RemoteJoined(2, 1)], "that target is done with"


def test_a_target_that_ends_twice_or_is_not_the_robots_counts_once_or_not_at_all() -> None:
    beside = Beside()
    beside.post(VisitTarget(5, PLACE))
    beside.post(TargetEnded(2, 4, TargetOutcome.REACHED), *[TargetEnded(2, 5, TargetOutcome.UNSAFE)] * 2)
    assert beside.heard == [TargetEnded(2, 5, TargetOutcome.UNSAFE)]


class Robots(Mission):
    """The agents of robots 1 and 2, and what stands for a task planner elsewhere.

    Attributes:
        told: what is said to the other process.
        planner: the machine that stands for the task planner.
    """

    def __init__(self) -> None:
        super().__init__(0)
        self.told: list[Event] = []
        whole = Mission(2)
        self.runtime, self.listeners, self.ports = Runtime(now=lambda: self.now_s), {}, whole.ports
        kits = {
            robot_id: RobotKit(
                robot_id, port, {}, lambda request, to: self.requests.append((request, to)), self.subscribe, 5, 0.5,
                120.0, 0.1, CAPABILITIES,
            )
            for robot_id, port in self.ports.items()
        }  # fmt: skip
        agents = {3: MachineRef(3, "RobotAgent 3", "elsewhere")}
        self.planner: MachineRef | None = None
        tasks = RemoteTasks(
            kits, self.told.append, self._name, agents, lambda *target: self.given.append(target),
            lambda *target: self.ended.append(target),
        )  # fmt: skip
        self.runtime.create(RemoteTaskPlanner, tasks)
        self.runtime.run()

    def _name(self, machine: MachineRef) -> None:
        self.planner = machine

    def say(self, *events: Event) -> None:
        """Deliver what the task planner's process says."""
        assert self.planner is not None
        for event in events:
            self.runtime.post(self.planner, event)
        self.run()

    def end(self, robot_id: int) -> None:
        """Let a robot's target end: the obstacle module has stepped in."""
        for event in (Reengaged(), Disengaged("obstacle", "test")):
            for machine in self.listeners[robot_id, type(event)]:
                self.runtime.post(machine, event)
        self.run()


def test_targets_are_numbered_anew_and_their_ends_told_by_the_planners_numbers() -> None:
    robots = Robots()
    robots.say(
        RemoteCame(),
        RemoteJoined(1, 2),
        RemoteJoined(1, 3),
        RemoteVisit(1, VisitTarget(70, PLACE)),
        RemoteVisit(2, VisitTarget(71, PLACE)),
    )
    assert robots.given == [(1, 1, PLACE), (2, 2, PLACE)]
    robots.end(2)
    assert robots.ended == [(2, 2, TargetOutcome.UNSAFE)]
    assert robots.told == [TargetEnded(2, 71, TargetOutcome.UNSAFE, "obstacle", "test")]


def test_what_a_new_planner_gives_waits_until_the_old_target_has_ended() -> None:
    robots = Robots()
    robots.say(RemoteCame(), RemoteVisit(1, VisitTarget(70, PLACE)))
    robots.say(RemoteCame(), RemoteVisit(1, VisitTarget(1, (3.0, 3.0))))
    assert robots.given == [(1, 1, PLACE)]
    robots.end(1)
    assert robots.ended == [(1, 1, TargetOutcome.UNSAFE)]
    assert robots.told == [], "the planner that gave it is no more"
    assert robots.given[1:] == [(1, 2, (3.0, 3.0))]
    robots.end(1)
    assert robots.told == [TargetEnded(1, 1, TargetOutcome.UNSAFE, "obstacle", "test")]


def test_robots_of_others_and_unknown_ones_are_left_alone() -> None:
    robots = Robots()
    robots.say(RemoteVisit(9, VisitTarget(1, PLACE)), RemoteJoined(9, 1), RemoteJoined(1, 9))
    assert robots.given == []
    assert robots.told == []


def test_a_task_planner_treats_robots_here_and_elsewhere_alike() -> None:
    here, told = Mission(1), list[Event]()
    runtime = here.runtime
    port = here.ports[1]
    kit = RobotKit(1, port, {}, lambda request, to: None, here.subscribe, 5, 0.5, 120.0, 0.1, CAPABILITIES)
    given: list[tuple[int, int, tuple[float, float]]] = []
    tasks = Tasks(
        {1: kit, 2: RemoteKit(2, told.append, lambda robot_id, machine: None)}, lambda robot_id: PLACE,
        lambda *target: given.append(target), lambda *target: None,
    )  # fmt: skip
    runtime.create(TaskPlanner, tasks)
    runtime.run()
    assert given == [(1, 1, PLACE), (2, 2, PLACE)]
    assert told == [RemoteJoined(2, 1), RemoteVisit(2, VisitTarget(2, PLACE))]
