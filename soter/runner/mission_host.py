"""The interface of mission hosts, which run the ACs: machines or controllers, in this process or their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

from soter.clock import Clock
from soter.geometry.workspace import Workspace
from soter.record.messages import TransitionEvent
from soter.record.recorder import TargetLog
from soter.rta import Report
from soter.sdk import Capabilities
from soter.stack.kit import RobotPort
from soter.stack.terrain import Terrain

ARRIVAL_M: Final = 0.10
"""Least distance from a target at which robots count as there."""


MAX_INCIDENTS: Final = 100
"""Most incidents of a mission that are kept."""


def arrival_m(promised: Capabilities) -> float:
    """Return how near to a target a robot counts as there: no less than how near it stops, with its noise."""
    return max(ARRIVAL_M, promised.overshoot_m + promised.position_noise_m)


@dataclass(frozen=True)
class OwnRoom:
    """The room that one robot takes.

    Attributes:
        terrain: distances of its body to fence and boxes.
        disc_m: distance that its plans keep from robots that stand in the way.
        arrival_m: distance from a target at which it counts as there.
    """

    terrain: Terrain
    disc_m: float
    arrival_m: float = ARRIVAL_M


@dataclass(frozen=True)
class Scene:
    """What the ACs see and use.

    Attributes:
        clock: fleet time.
        workspace: fence, boxes, chargers.
        rooms: by robot, the room that it takes.
        ports: the ACs' ports, by robot.
        log: called with targets, and with how they end.
        on_transition: called with every change of state of the mission's machines, or None; for recordings.
        peers: by robot, read-only ports of the robots that other processes command.
        capabilities: what the robots of the ports promise.
    """

    clock: Clock
    workspace: Workspace
    rooms: Mapping[int, OwnRoom]
    ports: Mapping[int, RobotPort]
    log: TargetLog
    on_transition: Callable[[TransitionEvent], None] | None = None
    peers: Mapping[int, RobotPort] = field(default_factory=dict)
    capabilities: Mapping[int, Capabilities] = field(default_factory=dict)


class MissionHost(Protocol):
    """Runs all untrusted code of a mission. Made before the robots are opened, so that bad options move nothing."""

    @property
    def failures(self) -> Mapping[int | None, str]:
        """Permanent failures, by robot; the key None is for a failure of what all robots depend on."""

    @property
    def not_begun(self) -> str:
        """Why the mission has not begun, in words; empty once it has."""

    @property
    def current_handler(self) -> str | None:
        """The handler that is running in this process, or None. Readable from any thread."""

    @property
    def paths_replaced(self) -> int:
        """Number of the untrusted planner's paths that were replaced."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to do, so that the run may end before its time is up."""

    @property
    def incidents(self) -> Sequence[str]:
        """Incidents that made this run non-deterministic; empty while it is deterministic."""

    @property
    def sandbox(self) -> Mapping[str, str] | None:
        """What the sandbox denies the ACs' process, and by which means; None if they run in this process."""

    @property
    def answers(self) -> int | None:
        """Number of ticks that the ACs' process has answered; None if they run in this process, and answer all."""

    def ready(self) -> None:
        """Wait until everything in other processes has started."""

    def start(self, scene: Scene) -> None:
        """Begin; called once, before the first tick."""

    def hear(self, report: Report) -> None:
        """Take a port's report. Called in the supervisor's thread, in the middle of a tick."""

    def receive(self) -> None:
        """Take what other processes have sent since the last tick. Called before every tick; never waits."""

    def run(self, now_s: float) -> None:
        """Run the ACs. Called after every tick, in the supervisor's thread."""

    def close(self) -> None:
        """End everything that was started. Idempotent."""
