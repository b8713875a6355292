"""What the machines of one process and those of others tell each other: events here, letters on the way."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from soter.distribution.bus import Bus
from soter.distribution.channel import MAX_REASON, Came, Ended, Joined, Letter, Visit
from soter.machine import Event, MachineRef, Runtime
from soter.runner.part import Part
from soter.stack.away import AwayKit, JoinedAway, OtherSideCame, VisitAway
from soter.stack.events import Outcome, TargetEnded, VisitTarget

logger = logging.getLogger(__name__)

_OUTCOMES: Final = {outcome.value: outcome for outcome in Outcome}


class Correspondence:
    """Brings the task planner's events to robots elsewhere and theirs to it. One thread: that of the machines.

    Args:
        part: which part of the mission is here.
        bus: open; closed with it.
        runtime: of the machines here.
    """

    def __init__(self, part: Part, bus: Bus, runtime: Runtime) -> None:
        self._part: Final = part
        self._runtime: Final = runtime
        self._post: Final = part.post(bus)
        self._agents: Final[dict[int, MachineRef]] = {}
        self._task_planner: MachineRef | None = None

    def kit(self, robot_id: int) -> AwayKit:
        """Return what stands for a robot of another process, beside the task planner."""
        return AwayKit(robot_id, partial(self._tell, self._part.homes[robot_id]), self._agents.__setitem__)

    def tell_task_planner(self, event: Event) -> None:
        """Send an event to the task planner's process."""
        self._tell(self._part.planner_home, event)

    def hears_task_planner(self, machine: MachineRef) -> None:
        """Name the machine that is told of what comes from the task planner's process."""
        self._task_planner = machine

    def pump(self, now_s: float) -> None:
        """Deliver what has come to the machines, and send what is due. Never waits."""
        for sender, letter in self._post.pump(now_s):
            for machine, event in self._delivered(sender, letter):
                self._runtime.post(machine, event)

    def close(self) -> None:
        """Leave the bus. Idempotent."""
        self._post.close()

    def _tell(self, process: str, event: Event) -> None:
        self._post.send(process, _LETTERS[type(event)](event))

    def _delivered(self, sender: str, letter: Letter | Came) -> Iterator[tuple[MachineRef, Event]]:
        """Return who is told of a letter, and by which event."""
        part = self._part
        if isinstance(letter, Came):
            for robot_id in part.robots_of(sender):
                if robot_id in self._agents:
                    yield self._agents[robot_id], OtherSideCame()
            if sender == part.planner_home and self._task_planner is not None:
                yield self._task_planner, OtherSideCame()
        elif isinstance(letter, Ended):
            outcome, agent = _OUTCOMES.get(letter.outcome), self._agents.get(letter.robot_id)
            if outcome is None or agent is None or part.homes[letter.robot_id] != sender:
                logger.warning("process '%s' says of robot %d what makes no sense: %s", sender, letter.robot_id, letter)
            else:
                yield agent, TargetEnded(letter.robot_id, letter.target_id, outcome, letter.module, letter.reason)
        elif self._task_planner is not None and sender == part.planner_home:
            if isinstance(letter, Visit):
                target = VisitTarget(letter.target_id, (letter.x_m, letter.y_m), letter.timeout_s, letter.tries)
                yield self._task_planner, VisitAway(letter.robot_id, target)
            else:
                yield self._task_planner, JoinedAway(letter.robot_id, letter.other_id)


def _visit(robot_id: int, target: VisitTarget) -> Visit:
    x_m, y_m = target.place
    return Visit(robot_id, target.target_id, x_m, y_m, target.timeout_s, target.tries)


_LETTERS: Final[dict[type[Event], Callable[..., Letter]]] = {
    VisitAway: lambda event: _visit(event.robot_id, event.target),
    JoinedAway: lambda event: Joined(event.robot_id, event.other_id),
    TargetEnded: lambda event: Ended(
        event.robot_id, event.target_id, event.outcome.value, event.module[:MAX_REASON], event.reason[:MAX_REASON]
    ),
}
