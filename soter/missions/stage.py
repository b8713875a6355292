"""What a mission works with when it begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from soter.geometry.workspace import Workspace
from soter.machine import Machine, MachineRef
from soter.stack.events import Place, TargetOutcome
from soter.stack.kit import RobotKit, RobotPort
from soter.stack.remote import RemoteKit


@dataclass(frozen=True)
class Stage:
    """Where a mission plays, and with what. Its machines talk to robot agents, or to ports where it has its own.

    Attributes:
        workspace: fence, boxes, chargers.
        body_radius_m: of the robots, by id.
        seed: of the run; whatever is drawn has to follow from it.
        tick_s: how often time passes.
        kits: what a robot's machines work with, by robot; of robots in other processes, what stands for them.
        ports: where robots are, by robot; those of robots in other processes take nothing.
        create: makes a machine, as `Machine.create` does: class, payload, name.
        on_target: to be told of every target given: robot, target id, place. For statistics and recordings.
        on_ended: to be told of every target that ended: robot, target id, outcome.
        say: writes a text to standard error, and into the recording under a name: name, text.
    """

    workspace: Workspace
    body_radius_m: Mapping[int, float]
    seed: int
    tick_s: float
    kits: Mapping[int, RobotKit | RemoteKit]
    ports: Mapping[int, RobotPort]
    create: Callable[[type[Machine], object, str], MachineRef]
    on_target: Callable[[int, int, Place], None]
    on_ended: Callable[[int, int, TargetOutcome], None]
    say: Callable[[str, str], None]
