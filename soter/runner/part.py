"""One process's part of a distributed mission: its own robots, the other processes, the bus between them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Self

from pydantic import BaseModel, TypeAdapter

from soter.clock import Clock
from soter.config import MissionFile, validate_options
from soter.controllers import MISSION
from soter.distribution.bus import Bus, bus_class
from soter.distribution.channel import ReliableChannel
from soter.distribution.peer_group import PeerGroup
from soter.distribution.status import VERSION
from soter.errors import ConfigError, nearest
from soter.geometry.site import SitePlan, plain
from soter.geometry.workspace import Workspace
from soter.registry import in_virtual_time
from soter.rta import SpeedBound
from soter.sdk import Backend, Capabilities
from soter.specs import promises_of

_EXAMPLE: Final = "give each a table, such as [distribution.processes.alpha] with robots = [1]"

_DIGEST_CHARACTERS: Final = 32
_AGREED: Final = {"backend", "base_tick_s", "battery", "rta", "fault"}
"""Settings on which all processes of a mission have to agree, beside workspace, promises, the robots' processes, and
whether the ACs are controllers."""


@dataclass(frozen=True)
class Part:
    """The part of one process.

    Attributes:
        name: name of the process.
        mission: the whole mission.
        robots: the ids of its own robots.
        planner: whether the task planner is in this process.
        homes: for all robots, the process that commands them.
        planner_home: the process of the task planner; empty if the ACs are controllers, which need none.
        promised: for all robots, what they promise.
        digest: equal in all processes that run the same mission.
    """

    name: str
    mission: MissionFile
    robots: tuple[int, ...]
    planner: bool
    homes: Mapping[int, str]
    planner_home: str
    promised: Mapping[int, Capabilities]
    digest: str

    @classmethod
    def of(cls, mission: MissionFile, workspace: Workspace, process: str) -> Self:
        """Return the part of a process.

        Raises:
            ConfigError: the mission has no such process, or cannot be distributed.
            BackendError: its backend cannot be loaded.
        """
        processes = mission.distribution.processes
        if not processes:
            raise mission.refusal("distribution", f"it names no processes, so that there is no '{process}'; {_EXAMPLE}")
        if process not in processes:
            known = ", ".join(processes)
            raise mission.refusal(
                "distribution.processes", f"there is no '{process}'{nearest(process, [*processes])}; known are {known}"
            )
        planners = [name for name, table in processes.items() if table.planner and mission.ac == MISSION]
        if not (processes[process].robots or planners):
            why = f"the ACs are '{mission.ac}', which need no task planner"
            raise mission.refusal(f"distribution.processes.{process}", f"it has no robots, and {why}; do not start it")
        if in_virtual_time(mission.backend):
            allowed = "allowed with processes: backends on a wire, such as zenoh or ros2"
            raise mission.refusal(
                "backend", f"it is '{mission.backend}', whose robots live in virtual time in one process; {allowed}"
            )
        promised = promises_of(mission, workspace)
        homes = {robot_id: name for name, table in processes.items() for robot_id in table.robots}
        return cls(
            process,
            mission,
            tuple(place.id for place in workspace.robots if homes[place.id] == process),
            process in planners,
            homes,
            next(iter(planners), ""),
            promised,
            _digest(mission, workspace, promised, homes),
        )

    @property
    def others(self) -> tuple[str, ...]:
        """The names of the other processes, except one that has nothing to do."""
        names = (*self.mission.distribution.processes,)
        return tuple(
            each for each in names if each != self.name and (each == self.planner_home or self.robots_of(each))
        )

    def robots_of(self, process: str) -> tuple[int, ...]:
        """Return the ids of the robots that a process commands."""
        return tuple(robot_id for robot_id, name in self.homes.items() if name == process)

    def bus_options(self) -> tuple[type[Bus], BaseModel]:
        """Return the class of the bus between the processes, and this process's options of it.

        Raises:
            ConfigError: there is no such bus, or it does not allow an option.
        """
        table = self.mission.distribution
        kind, own = (
            bus_class(table.via, partial(self.mission.refusal, "distribution.via")),
            table.processes[self.name].bus,
        )
        key = f"distribution.processes.{self.name}.bus" if own else "distribution.bus"
        return kind, validate_options(
            kind.options_model, {**table.bus, **own}, self.mission.source, key, overridden=self.mission.overridden
        )

    def open_bus(self) -> Bus:
        """Open the bus between the processes.

        Raises:
            ConfigError: see `bus_options`.
            BackendError: the bus cannot be opened.
        """
        kind, options = self.bus_options()
        return kind.open(options)

    def peer_group(self, bus: Bus, clock: Clock) -> PeerGroup:
        """Return the peer group of this process, on a bus that the group then closes."""
        others = {
            name: {robot_id: _bound(self.promised[robot_id]) for robot_id in self.robots_of(name)}
            for name in self.others
        }
        return PeerGroup(bus, self.mission.distribution.prefix, self.name, others, self.digest, clock)

    def reliable_channel(self, bus: Bus) -> ReliableChannel:
        """Return the channel between a task planner and robots elsewhere, on a bus that the channel then closes."""
        others = [name for name in self.others if self.planner or name == self.planner_home]
        return ReliableChannel(bus, self.mission.distribution.prefix, self.name, others, self.digest)


def refuse_in_one_process(mission: MissionFile, backend: type[Backend]) -> None:
    """Refuse to command the robots of several processes from one, unless they are simulated in this process.

    Raises:
        ConfigError: the mission is distributed, and its robots are not simulated in this process.
    """
    processes = mission.distribution.processes
    if processes and not backend.robot_class.declared.in_process:
        raise ConfigError(
            f"this mission is distributed; say which process this is: --process {' or --process '.join(processes)}",
            source=mission.source, key="distribution.processes",
        )  # fmt: skip


def _bound(promised: Capabilities) -> tuple[SpeedBound, float]:
    return SpeedBound(promised.v_max_m_s, promised.brake_m_s2), promised.position_noise_m


def _digest(
    mission: MissionFile, workspace: Workspace, promised: Mapping[int, Capabilities], homes: Mapping[int, str]
) -> str:
    room = TypeAdapter(tuple[Workspace | SitePlan, dict[int, Capabilities]]).dump_python(
        (plain(workspace), dict(promised)), mode="json"
    )
    settings = mission.model_dump(mode="json", include=_AGREED)
    agreed = json.dumps([VERSION, settings, room, sorted(homes.items()), mission.ac == MISSION], sort_keys=True)
    return hashlib.sha256(agreed.encode()).hexdigest()[:_DIGEST_CHARACTERS]
