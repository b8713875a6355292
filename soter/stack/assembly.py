"""Puts the safety side of a mission together: for every robot its modules, safe controllers, port and supervisor."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

from soter.config import MissionFile
from soter.controller import SC
from soter.errors import IllFormedModule
from soter.geometry.workspace import Workspace
from soter.rta import (
    PEER_SILENT_S,
    Actuator,
    Assumed,
    DecisionModule,
    Drivers,
    PairBound,
    PeerMonitor,
    Port,
    RemotePeer,
    Report,
    RobotSupervisor,
    RTAModule,
    SpeedBound,
    StillPeers,
    Supervisor,
    Topic,
    Watch,
)
from soter.sdk import Capabilities, Robot, RobotState, Waypoint
from soter.stack.actuator import PortForwarder, RobotActuator
from soter.stack.declaration import Declared, declare, terrains_of, timing_of
from soter.stack.monitors import ChargeMonitor, ContractMonitor
from soter.stack.peers import PeerBounds, Peers
from soter.stack.right_of_way import AHEAD_S, BATTERY, COLLISION, RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.terrain import Terrain

NEIGHBOUR_M: Final = 2.5


@dataclass(frozen=True)
class Study:
    """Changes to the modules for studies in simulation; never for robots.

    Attributes:
        deltas: how many Delta the modules look ahead; None for what proofs need.
        safer_alone: whether modules give control back wherever phi_safer holds, even if the AC could break the rule
            before the next look.
        on_ill_formed: called with the error of an ill-formed module, which is then bound all the same; None raises it.
    """

    deltas: float | None = None
    safer_alone: bool = False
    on_ill_formed: Callable[[IllFormedModule], None] | None = None


@dataclass(frozen=True)
class SafeRobot:
    """The safety side of one robot.

    Attributes:
        port: the AC's access to the robot, and all of it that the mission sees.
        forwarder: has the AC's latest request.
        declared: the robot's modules and what their safe controllers share.
        terrain: the static workspace for the robot's body.
        trigger_m: the distance to another robot at which the collision module acts.
    """

    port: Port[Waypoint, RobotState]
    forwarder: PortForwarder
    declared: Declared
    terrain: Terrain
    trigger_m: float


@dataclass(frozen=True)
class SafetySide:
    """The safety side of a mission: all that stands between its machines and the robots."""

    supervisor: Supervisor
    robots: Mapping[int, SafeRobot]

    @cached_property
    def ports(self) -> Mapping[int, Port[Waypoint, RobotState]]:
        """The AC's ports, by robot id."""
        return {robot_id: robot.port for robot_id, robot in self.robots.items()}

    @cached_property
    def modules(self) -> Mapping[int, tuple[RTAModule, ...]]:
        """The declarations, by robot id, in order of priority."""
        return {robot_id: robot.declared.modules for robot_id, robot in self.robots.items()}

    def charging(self, robot_id: int) -> bool:
        """Return whether a robot stands on its station because it has to charge."""
        return self.robots[robot_id].declared.dock.charging(self.supervisor.robots[robot_id].situation)


@dataclass(frozen=True)
class Others:
    """The robots that other processes supervise.

    Attributes:
        peers: the source of their samples.
        promises: the capabilities that each promises, by id.
    """

    peers: Sequence[RemotePeer] = ()
    promises: Mapping[int, Capabilities] = field(default_factory=dict)


def assemble(
    mission: MissionFile,
    workspace: Workspace,
    robots: Sequence[Robot],
    listener: Callable[[Report], None],
    watches: Sequence[Watch] = (),
    *,
    tap: Callable[[int, RobotActuator], Actuator] | None = None,
    study: Study = Study(),
    others: Others = Others(),
) -> SafetySide:
    """Declare the enabled modules for every robot, check them against its capabilities, and bind them.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: fence, boxes, chargers.
        robots: ready, with their SC active.
        listener: called with the ports' reports.
        watches: called with every switch.
        tap: wraps each robot's actuator for its supervisor, such as in one that records all calls.
        study: changes to the modules.
        others: the robots that other processes supervise.

    Raises:
        IllFormedModule: before anything moves; names the module, the condition, the numbers and a value that would do.
    """
    promises = {**{robot.id: robot.capabilities for robot in robots}, **others.promises}
    apart = COLLISION in mission.rta.order
    low = {peer.robot_id: peer.needs_charge for peer in others.peers}
    fleet = [*promises.values()]
    worst = PeerBounds.of(fleet, mission.base_tick_s)
    terrains = terrains_of(workspace, promises)
    safe: dict[int, SafeRobot] = {}
    right_of_way = RightOfWay(
        mission.rta.collision.phi_safer_m if apart else 0.0,
        lambda robot_id: robot_id in low and low[robot_id](),
        lambda robot_id: max(
            safe[robot_id].declared.recovery.apart_m(worst.sample_age_s), safe[robot_id].declared.apart_m
        ),
        lambda robot_id, x_m, y_m: safe[robot_id].declared.dock.path.legs(x_m, y_m),
        lambda bound: safe[bound.robot_id].declared.dock.docked(bound.situation),
        2.0 * (worst.noise_m + worst.v_max_m_s * worst.sample_age_s),
        lambda robot_id: AHEAD_S * promises[robot_id].v_max_m_s,
    )
    supervisors: list[RobotSupervisor] = []
    for robot in robots:
        port: Port[Waypoint, RobotState] = Port(robot.id, listener)
        waypoint: Topic[Any] = Topic(WAYPOINT)
        forwarder = PortForwarder(port, waypoint, mission.base_tick_s)
        declared = declare(
            mission, workspace, terrains[robot.id], robot.id, robot.capabilities,
            Peers.of(robot.id, promises, mission.base_tick_s), forwarder, right_of_way,
        )  # fmt: skip
        try:
            declared.check(mission.base_tick_s)
        except IllFormedModule as refusal:
            if study.on_ill_formed is None:
                raise
            study.on_ill_formed(refusal)
        judged = replace(declared.timing, deltas=study.deltas)
        actuator = RobotActuator(robot, port)
        decisions = [
            DecisionModule(
                each, judged, mission.base_tick_s, right_of_way, study.safer_alone, each.name in mission.rta.module
            )
            for each in declared.modules
        ]
        supervisors.append(
            RobotSupervisor(
                robot.id,
                actuator if tap is None else tap(robot.id, actuator),
                # The battery's module comes last if it is on; it drives once the AC has failed.
                Drivers(decisions, forwarder, waypoint, mission.rta.order[-1] if mission.rta.order else ""),
                Assumed(
                    # Models that the robot's own samples are tested against: each once, however many modules share it.
                    list(dict.fromkeys(each.model.of_own() for each in declared.modules if each.model is not None)),
                    declared.timing,
                    PEER_SILENT_S if apart and len(promises) > 1 else math.inf,
                ),
                watches,
            )
        )
        trigger_m = _trigger_m(mission, robot.capabilities, worst)
        safe[robot.id] = SafeRobot(port, forwarder, declared, terrains[robot.id], trigger_m)

    docks = {robot_id: each.declared.dock for robot_id, each in safe.items()}
    contracts = ContractMonitor({robot.id: robot.capabilities.moving_m_s for robot in robots})
    charges = ChargeMonitor()
    batteries = {each.robot_id: module for each in supervisors for module in each.modules if module.name == BATTERY}

    homes = [(each, docks[each.robot_id], batteries.get(each.robot_id)) for each in supervisors]

    def before_decisions(now_s: float, bound: Mapping[int, RobotSupervisor]) -> None:
        waits = False
        for supervisor, dock, battery in homes:
            own = supervisor.situation.own
            dock.path.track(own.x_m, own.y_m)
            if battery is not None:
                dock.begins = battery.begins(now_s)
                dock.wants_charge = wants = battery.mode is SC and not dock.begins
                waits = waits or wants
        if waits:
            contracts.look(now_s, bound, docks)
        else:
            contracts.rest()
        charges.look(now_s, bound, docks)
        right_of_way.update(now_s, bound)

    watched = PeerMonitor(
        {
            robot_id: (SpeedBound(each.v_max_m_s, each.brake_m_s2), each.position_noise_m)
            for robot_id, each in promises.items()
        },
        PEER_SILENT_S,
    )
    still_s = _still_s(fleet, mission.base_tick_s)
    # Silent robots, one or both of a pair, may be nearer to each other than their samples are.
    unheard_m = worst.v_max_m_s * (PEER_SILENT_S + still_s)
    # A user's rule may be about peers that are too far away to matter to a shipped rule.
    theirs_m = max((module.peers_within_m for each in safe.values() for module in each.declared.own), default=0.0)
    supervisor = Supervisor(
        supervisors, mission.base_tick_s,
        max(NEIGHBOUR_M, mission.rta.collision.phi_safer_m + max(1.0, unheard_m), theirs_m), before_decisions,
        watched if apart else None,
        StillPeers(still_s) if apart else None,
        others.peers if apart else (),
    )  # fmt: skip
    return SafetySide(supervisor, safe)


def _still_s(promises: Sequence[Capabilities], base_tick_s: float) -> float:
    """Return how long a silent robot can move on after its last sample, with braking counted as half.

    The supervisor renews the lease of a robot that it does not hear of while the last sample is at most
    `PEER_SILENT_S` old. A robot of another supervisor knows which of its samples was heard, and holds at the next tick
    after that time.
    """
    return PEER_SILENT_S + max(
        max(each.lease_s, base_tick_s + each.jitter_s) + each.latency_s + each.v_max_m_s / (2.0 * each.brake_m_s2)
        for each in promises
    )


def _trigger_m(mission: MissionFile, own: Capabilities, worst: PeerBounds) -> float:
    collision = mission.rta.collision
    look_s = timing_of(own, mission.base_tick_s).look_s(collision.delta_s)
    speeds = SpeedBound(own.v_max_m_s, own.brake_m_s2), SpeedBound(worst.v_max_m_s, worst.brake_m_s2)
    return collision.phi_safe_m + PairBound(*speeds).bound(look_s)
