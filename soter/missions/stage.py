"""The stage: what a mission works with."""

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
    """What a mission works with. Its machines talk to robot agents, or, if it has agents of its own, to ports.

    Attributes:
        workspace: fence, boxes, chargers.
        body_radius_m: body radii of the robots, by id.
        seed: the run's seed; all random numbers have to follow from it.
        tick_s: period of the tick.
        kits: what a robot's machines work with, by robot; for robots in other processes, the kits of their proxies.
        ports: ports by robot; those of robots in other processes are read-only.
        create: makes a machine, as `Machine.create` does: class, payload, name.
        on_target: to be called with every target given: robot, target id, place. For statistics and recordings.
        on_ended: to be called with every target that ended: robot, target id, outcome.
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
