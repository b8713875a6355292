"""What runs the ACs, as the runner needs it: machines or controllers, in this process or in one of their own."""

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
"""How near is reached, for robots that get so near."""


MAX_INCIDENTS: Final = 100
"""What a mission tells of incidents beyond so many is left out."""


def arrival_m(promised: Capabilities) -> float:
    """Return how near to a target a robot counts as there: no nearer than it stops, as it is seen."""
    return max(ARRIVAL_M, promised.overshoot_m + promised.position_noise_m)


@dataclass(frozen=True)
class OwnRoom:
    """The room that one robot takes.

    Attributes:
        terrain: fence and boxes, as distances of its body.
        disc_m: distance that its plans keep from robots that stand in the way.
        arrival_m: how near to a target is reached.
    """

    terrain: Terrain
    disc_m: float
    arrival_m: float = ARRIVAL_M


@dataclass(frozen=True)
class Scene:
    """What the ACs get to see and use.

    Attributes:
        clock: fleet time.
        workspace: fence, boxes, chargers.
        rooms: by robot, the room that it takes.
        ports: the ACs' rights, by robot.
        log: told of targets.
        on_transition: told of every change of state of the mission's machines, or None; for recordings.
        peers: the robots that other processes command, by robot: ports that show where they are and take nothing.
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
    """Everything that is untrusted. Made before the robots are opened, so that bad options move nothing."""

    @property
    def failures(self) -> Mapping[int | None, str]:
        """What failed for good, by robot; None for what all robots depend on."""

    @property
    def current_handler(self) -> str | None:
        """What is running right now in this process, or None. Readable from any thread."""

    @property
    def paths_replaced(self) -> int:
        """How many paths of the untrusted planner were not used."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to do, so that the run may end before its time is up."""

    @property
    def incidents(self) -> Sequence[str]:
        """What made this run one that does not repeat; empty while it does."""

    @property
    def sandbox(self) -> Mapping[str, str] | None:
        """What is taken from the process that they run in, and by what; None where that is this one."""

    def ready(self) -> None:
        """Wait until everything that runs elsewhere has started."""

    def start(self, scene: Scene) -> None:
        """Begin; called once, before the first tick."""

    def hear(self, report: Report) -> None:
        """Take what a port reports. Called in the supervisor's thread, in the middle of a tick."""

    def receive(self) -> None:
        """Take what was said elsewhere since the last tick. Called before every tick; never waits."""

    def run(self, now_s: float) -> None:
        """Do what is to be done now. Called after every tick, in the supervisor's thread."""

    def close(self) -> None:
        """End everything that was started. Idempotent."""
