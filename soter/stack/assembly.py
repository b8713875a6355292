"""Puts the safety side of a mission together: for every robot its modules, safe controllers, port and supervisor."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

from soter.config import MissionFile
from soter.errors import IllFormedModule
from soter.geometry.workspace import Workspace
from soter.rta import (
    PEER_SILENT_S,
    STARTS,
    Actuator,
    DecisionModule,
    Mode,
    PairBound,
    PeerMonitor,
    Port,
    ReachModel,
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
from soter.stack.battery import Dock
from soter.stack.declaration import declare, terrains_of, timing_of
from soter.stack.monitors import ChargeMonitor, ContractMonitor
from soter.stack.peers import PeerBounds, Peers
from soter.stack.recovery import RecoveryPlanner
from soter.stack.right_of_way import BATTERY, COLLISION, RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.terrain import Terrain

NEIGHBOUR_M: Final = 2.5

_BEGINS_S: Final = 2.0
"""For so long after its first look a robot has not fired its battery's module only because all begin in SC."""


@dataclass(frozen=True)
class SafetySide:
    """What stands between the mission and the robots.

    Attributes:
        supervisor: ticks everything.
        ports: the AC's rights, by robot id; all that the mission gets to see.
        recoveries: by robot id, for their counters.
        forwarders: by robot id; they know what the AC asked for last.
        modules: the declarations, by robot id, in order of their right to drive.
        terrains: the static workspace, by robot: for its body.
        trigger_m: by robot, the distance to another one at which its collision module acts.
        charging: whether a robot stands on its station because it has to charge.
        own: the user's modules, by robot id, those that are off included.
    """

    supervisor: Supervisor
    ports: Mapping[int, Port[Waypoint, RobotState]]
    recoveries: Mapping[int, RecoveryPlanner]
    forwarders: Mapping[int, PortForwarder]
    modules: Mapping[int, tuple[RTAModule, ...]]
    terrains: Mapping[int, Terrain]
    trigger_m: Mapping[int, float]
    charging: Callable[[int], bool]
    own: Mapping[int, tuple[RTAModule, ...]]


def assemble(
    mission: MissionFile,
    workspace: Workspace,
    robots: Sequence[Robot],
    listener: Callable[[Report], None],
    watches: Sequence[Watch] = (),
    *,
    tap: Callable[[int, RobotActuator], Actuator] | None = None,
    on_ill_formed: Callable[[IllFormedModule], None] | None = None,
    deltas: float | None = None,
    safer_alone: bool = False,
    remote: Sequence[RemotePeer] = (),
    remote_promises: Mapping[int, Capabilities] = MappingProxyType({}),
) -> SafetySide:
    """Declare the enabled modules for every robot, check them against its capabilities, and bind them.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: fence, boxes, chargers.
        robots: ready, with their SC in charge.
        listener: told of what the ports report.
        watches: told of every switch.
        tap: returns what a supervisor uses in place of a robot's actuator, such as one that writes down what passes.
        on_ill_formed: takes the refusal of a module and has it bound all the same; for questions, never for robots.
        deltas: how many Delta the modules look ahead when they judge, in place of what proofs need; a question too.
        safer_alone: the modules give back wherever phi_safer holds, within reach of phi_safe's edge or not; another.
        remote: the robots that other processes supervise.
        remote_promises: by robot, what each of those promises.

    Raises:
        IllFormedModule: before anything moves; names the module, the condition, the numbers and a value that would do.
    """
    promises = {**{robot.id: robot.capabilities for robot in robots}, **remote_promises}
    apart = COLLISION in mission.rta.order
    low = {peer.robot_id: peer.needs_charge for peer in remote}
    fleet = [*promises.values()]
    worst = PeerBounds.of(fleet, mission.base_tick_s)
    terrains = terrains_of(workspace, promises)
    ports: dict[int, Port[Waypoint, RobotState]] = {}
    recoveries: dict[int, RecoveryPlanner] = {}
    forwarders: dict[int, PortForwarder] = {}
    modules: dict[int, tuple[RTAModule, ...]] = {}
    own: dict[int, tuple[RTAModule, ...]] = {}
    docks: dict[int, Dock] = {}
    own_apart_m: dict[int, float] = {}
    right_of_way = RightOfWay(
        mission.rta.collision.phi_safer_m if apart else 0.0,
        lambda robot_id: robot_id in low and low[robot_id](),
        lambda robot_id: max(recoveries[robot_id].apart_m(worst.sample_age_s), own_apart_m[robot_id]),
        lambda robot_id, x_m, y_m: docks[robot_id].path.legs(x_m, y_m),
        lambda bound: docks[bound.robot_id].docked(bound.situation),
    )
    supervisors: list[RobotSupervisor] = []
    for robot in robots:
        port: Port[Waypoint, RobotState] = Port(robot.id, listener)
        waypoint: Topic[Any] = Topic(WAYPOINT)
        forwarder = PortForwarder(port, waypoint, mission.base_tick_s)
        declared = declare(
            mission, workspace, terrains[robot.id], robot.id, robot.capabilities,
            Peers.of(robot.id, promises, mission.base_tick_s), forwarder, waypoint, right_of_way,
        )  # fmt: skip
        try:
            declared.check(mission.base_tick_s)
        except IllFormedModule as refusal:
            if on_ill_formed is None:
                raise
            on_ill_formed(refusal)
        judged = replace(declared.timing, deltas=deltas)
        actuator = RobotActuator(robot, port)
        supervisors.append(
            RobotSupervisor(
                robot.id,
                actuator if tap is None else tap(robot.id, actuator),
                [
                    DecisionModule(each, judged, mission.base_tick_s, right_of_way, safer_alone)
                    for each in declared.modules
                ],
                forwarder,
                waypoint,
                _monitored(declared.modules),
                declared.timing,
                watches,
                PEER_SILENT_S if apart and len(promises) > 1 else math.inf,
                # The way home comes last, where it is kept.
                mission.rta.order[-1] if mission.rta.order else "",
            )
        )
        ports[robot.id], recoveries[robot.id], docks[robot.id] = port, declared.recovery, declared.dock
        forwarders[robot.id], modules[robot.id], own[robot.id] = forwarder, declared.modules, declared.own
        own_apart_m[robot.id] = declared.apart_m

    contracts = ContractMonitor({robot.id: robot.capabilities.moving_m_s for robot in robots})
    charges = ChargeMonitor()

    def before_decisions(now_s: float, bound: Mapping[int, RobotSupervisor]) -> None:
        for robot_id, supervisor in bound.items():
            dock, own = docks[robot_id], supervisor.situation.own
            dock.path.track(own.x_m, own.y_m)
            battery = next((module for module in supervisor.modules if module.name == BATTERY), None)
            if battery is not None:
                in_sc = battery.mode is Mode.SC
                # All modules begin in SC; for a while that does not mean that the battery's has fired.
                dock.begins = in_sc and battery.cause == STARTS and not now_s - battery.since_s > _BEGINS_S
                dock.wants_charge = in_sc and not dock.begins
        contracts.look(now_s, bound, docks)
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
    # Robots that are not heard, of a pair one or both, may be nearer to each other than their samples are.
    unheard_m = worst.v_max_m_s * (PEER_SILENT_S + still_s)
    # A user's rule may be about peers that matter to no shipped one.
    theirs_m = max((module.peers_within_m for each in own.values() for module in each), default=0.0)
    supervisor = Supervisor(
        supervisors, mission.base_tick_s,
        max(NEIGHBOUR_M, mission.rta.collision.phi_safer_m + max(1.0, unheard_m), theirs_m), before_decisions,
        watched if apart else None,
        StillPeers(still_s) if apart else None,
        remote if apart else (),
    )  # fmt: skip
    bound = supervisor.robots
    return SafetySide(
        supervisor,
        ports,
        recoveries,
        forwarders,
        modules,
        terrains,
        {robot.id: _trigger_m(mission, robot.capabilities, worst) for robot in robots},
        lambda robot_id: docks[robot_id].charging(bound[robot_id].situation),
        own,
    )


def _still_s(promises: Sequence[Capabilities], base_tick_s: float) -> float:
    """Return how long a robot moves on at most after the last sample that was heard of it, braking as half.

    One that its own supervisor does not hear of has its lease renewed while the sample is `PEER_SILENT_S` old at most.
    One of another supervisor is told to hold at the next tick after that: it knows which sample was heard.
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


def _monitored(modules: Sequence[RTAModule]) -> list[ReachModel]:
    """Return what the modules assume of the robot's own samples, each model once however many modules share it."""
    return list(dict.fromkeys(module.model.of_own() for module in modules if module.model is not None))
