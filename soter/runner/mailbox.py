"""Carries events between the machines of different processes, as reliable messages on the bus."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from soter.distribution.bus import Bus
from soter.distribution.channel import MAX_REASON, Came, Ended, Joined, ReliableMessage, VisitMessage
from soter.machine import Event, MachineRef, Runtime
from soter.runner.part import Part
from soter.stack.events import OUTCOMES, TargetEnded, VisitTarget
from soter.stack.remote import RemoteCame, RemoteJoined, RemoteKit, RemoteVisit

logger = logging.getLogger(__name__)


class Mailbox:
    """Passes events between the task planner and robots in other processes. Used from the machines' thread only."""

    def __init__(self, part: Part, bus: Bus, runtime: Runtime) -> None:
        self._part: Final = part
        self._runtime: Final = runtime
        self._channel: Final = part.reliable_channel(bus)
        self._agents: Final[dict[int, MachineRef]] = {}
        self._task_planner: MachineRef | None = None

    def kit(self, robot_id: int) -> RemoteKit:
        """Return the kit of the proxy for a robot of another process, for use beside the task planner."""
        return RemoteKit(robot_id, partial(self._tell, self._part.homes[robot_id]), self._agents.__setitem__)

    def tell_task_planner(self, event: Event) -> None:
        """Send an event to the task planner's process."""
        self._tell(self._part.planner_home, event)

    def hears_task_planner(self, machine: MachineRef) -> None:
        """Set the machine that receives the events from the task planner's process."""
        self._task_planner = machine

    def pump(self, now_s: float) -> None:
        """Deliver received messages to the machines, and send what is due. Never waits."""
        for sender, message in self._channel.pump(now_s):
            for machine, event in self._delivered(sender, message):
                self._runtime.post(machine, event)

    def close(self) -> None:
        """Leave the bus. Idempotent."""
        self._channel.close()

    def _tell(self, process: str, event: Event) -> None:
        self._channel.send(process, _MESSAGES[type(event)](event))

    def _delivered(self, sender: str, message: ReliableMessage | Came) -> Iterator[tuple[MachineRef, Event]]:
        """Yield the machines that receive a message, each with its event."""
        part = self._part
        if isinstance(message, Came):
            for robot_id in part.robots_of(sender):
                if robot_id in self._agents:
                    yield self._agents[robot_id], RemoteCame()
            if sender == part.planner_home and self._task_planner is not None:
                yield self._task_planner, RemoteCame()
        elif isinstance(message, Ended):
            outcome, agent = OUTCOMES.get(message.outcome), self._agents.get(message.robot_id)
            if outcome is None or agent is None or part.homes[message.robot_id] != sender:
                logger.warning("process '%s' sends nonsense about robot %d: %s", sender, message.robot_id, message)
            else:
                yield agent, TargetEnded(message.robot_id, message.target_id, outcome, message.module, message.reason)
        elif self._task_planner is not None and sender == part.planner_home:
            if isinstance(message, VisitMessage):
                target = VisitTarget(message.target_id, (message.x_m, message.y_m), message.timeout_s, message.tries)
                yield self._task_planner, RemoteVisit(message.robot_id, target)
            else:
                yield self._task_planner, RemoteJoined(message.robot_id, message.other_id)


def _visit(robot_id: int, target: VisitTarget) -> VisitMessage:
    x_m, y_m = target.place
    return VisitMessage(robot_id, target.target_id, x_m, y_m, target.timeout_s, target.tries)


_MESSAGES: Final[dict[type[Event], Callable[..., ReliableMessage]]] = {
    RemoteVisit: lambda event: _visit(event.robot_id, event.target),
    RemoteJoined: lambda event: Joined(event.robot_id, event.other_id),
    TargetEnded: lambda event: Ended(
        event.robot_id, event.target_id, event.outcome.value, event.module[:MAX_REASON], event.reason[:MAX_REASON]
    ),
}
