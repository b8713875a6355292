"""Puts the safety side of a mission together: for every robot its modules, safe controllers, port and supervisor."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from soter.config import Mission
from soter.rta import (
    DecisionModule,
    DischargeBound,
    Mode,
    PairBound,
    Port,
    ReachModel,
    Report,
    RobotSupervisor,
    RTAModule,
    SpeedBound,
    Supervisor,
    Timing,
    Topic,
    Watch,
)
from soter.sdk import Capabilities, Robot, RobotState, Waypoint
from soter.stack.actuator import PortForwarder, RobotActuator
from soter.stack.battery import Charged, ChargeForTheWayHome, Dock, GoHome
from soter.stack.collision import BackAway, Separation
from soter.stack.geofence import Fence
from soter.stack.obstacle import Clearance
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.refuge import RefugeFinder
from soter.stack.right_of_way import BATTERY, COLLISION, RightOfWay
from soter.stack.safe_controller import WAYPOINT, Retreat
from soter.stack.terrain import Terrain
from soter.workspace import Workspace

OBSTACLE: Final = "obstacle"
GEOFENCE: Final = "geofence"
ORDER: Final = (COLLISION, OBSTACLE, GEOFENCE, BATTERY)
"""The order in which modules may drive: the highest that is in SC does."""

HOME_CLEARANCE_M: Final = 0.15
"""Body clearance that ways home keep from boxes, so that the obstacle module does not interfere."""

NEIGHBOUR_M: Final = 2.5
_SLACK_M: Final = 0.02
_REFUGE_PEER_M: Final = 0.5


@dataclass(frozen=True)
class SafetySide:
    """What stands between the mission and the robots.

    Attributes:
        supervisor: ticks everything.
        ports: the AC's rights, by robot id; all that the mission gets to see.
        recoveries: by robot id, for their counters.
        forwarders: by robot id; they know what the AC asked for last.
        modules: the declarations, by robot id, in order of their right to drive.
        terrain: the static workspace.
        trigger_m: distance between two robots at which the collision module acts.
        charging: whether a robot stands on its station because it has to charge.
    """

    supervisor: Supervisor
    ports: Mapping[int, Port[Waypoint, RobotState]]
    recoveries: Mapping[int, RecoveryPlanner]
    forwarders: Mapping[int, PortForwarder]
    modules: Mapping[int, tuple[RTAModule, ...]]
    terrain: Terrain
    trigger_m: float
    charging: Callable[[int], bool]


def assemble(
    mission: Mission,
    workspace: Workspace,
    robots: Sequence[Robot],
    listener: Callable[[Report], None],
    watches: Sequence[Watch] = (),
) -> SafetySide:
    """Declare the enabled modules for every robot, check them against its capabilities, and bind them.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: fence, boxes, chargers.
        robots: ready, with their SC in charge.
        listener: told of what the ports report.
        watches: told of every switch.

    Raises:
        IllFormedModule: before anything moves; names the module, the condition, the numbers and a value that would do.
    """
    right_of_way = RightOfWay()
    peer_v_max_m_s = max(robot.capabilities.v_max_m_s for robot in robots)
    peer_brake_m_s2 = min(robot.capabilities.brake_m_s2 for robot in robots)
    peer_noise_m = max(robot.capabilities.position_noise_m for robot in robots)
    terrain = Terrain(workspace, max(robot.capabilities.body_radius_m for robot in robots))
    places = {place.id: place for place in workspace.robots}
    ports: dict[int, Port[Waypoint, RobotState]] = {}
    recoveries: dict[int, RecoveryPlanner] = {}
    forwarders: dict[int, PortForwarder] = {}
    modules: dict[int, tuple[RTAModule, ...]] = {}
    docks: dict[int, Dock] = {}
    supervisors: list[RobotSupervisor] = []
    for robot in robots:
        capabilities = robot.capabilities
        port: Port[Waypoint, RobotState] = Port(robot.id, listener)
        waypoint: Topic[Any] = Topic(WAYPOINT)
        forwarder = PortForwarder(port, waypoint, mission.base_tick_s)
        recovery = RecoveryPlanner(
            terrain, capabilities, _rules(mission), mission.base_tick_s, peer_noise_m, peer_v_max_m_s
        )
        dock = Dock(
            terrain,
            places[robot.id].charger,
            HOME_CLEARANCE_M,
            _inset_m(mission, capabilities),
            _cost_per_m(mission, capabilities),
        )
        declared = _declare(
            mission,
            capabilities,
            terrain,
            dock,
            forwarder,
            waypoint,
            recovery,
            right_of_way,
            SpeedBound(peer_v_max_m_s, peer_brake_m_s2),
            peer_noise_m,
        )
        timing = Timing(
            capabilities.latency_s, capabilities.sample_age_s, capabilities.jitter_s, capabilities.position_noise_m,
            capabilities.lease_s,
        )  # fmt: skip
        for module in declared:
            module.check(timing, mission.base_tick_s)
        supervisors.append(
            RobotSupervisor(
                robot.id,
                RobotActuator(robot, port),
                [DecisionModule(module, timing, mission.base_tick_s, right_of_way) for module in declared],
                forwarder,
                waypoint,
                _monitored(declared),
                timing,
                watches,
            )
        )
        ports[robot.id], recoveries[robot.id], docks[robot.id] = port, recovery, dock
        forwarders[robot.id], modules[robot.id] = forwarder, declared

    def before_decisions(now_s: float, bound: Mapping[int, RobotSupervisor]) -> None:
        for robot_id, supervisor in bound.items():
            docks[robot_id].wants_charge = any(
                module.name == BATTERY and module.mode is Mode.SC for module in supervisor.modules
            )
        right_of_way.update(now_s, bound)

    supervisor = Supervisor(supervisors, mission.base_tick_s, NEIGHBOUR_M, before_decisions)
    bound = supervisor.robots
    return SafetySide(
        supervisor,
        ports,
        recoveries,
        forwarders,
        modules,
        terrain,
        _trigger_m(mission, robots),
        lambda robot_id: docks[robot_id].charging(bound[robot_id].situation),
    )


def enabled(mission: Mission) -> tuple[str, ...]:
    """Return the names of the enabled modules, in order of their right to drive."""
    return tuple(name for name in ORDER if mission.rta.enabled and name in mission.rta.modules)


def _trigger_m(mission: Mission, robots: Sequence[Robot]) -> float:
    collision = mission.rta.collision
    look_s = max(
        max(2.0 * collision.delta_s, r.capabilities.lease_s) + r.capabilities.latency_s + r.capabilities.jitter_s
        for r in robots
    )
    reach_m = max(SpeedBound(r.capabilities.v_max_m_s, r.capabilities.brake_m_s2).bound(look_s) for r in robots)
    return collision.phi_safe_m + 2.0 * reach_m


def _rules(mission: Mission) -> RecoveryRules:
    names = enabled(mission)
    return RecoveryRules(
        fence=GEOFENCE in names,
        boxes=OBSTACLE in names,
        pairs=COLLISION in names,
        separation_m=mission.rta.collision.phi_safe_m,
    )


def _inset_m(mission: Mission, capabilities: Capabilities) -> float:
    """Return how near ways home may come to the fence: not so near that the geofence module would step in.

    Without that module robots may be anywhere on the open ground around the fence, and ways lead there too.
    """
    if GEOFENCE not in enabled(mission):
        return -math.inf
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    look_s = 2.0 * mission.rta.geofence.delta_s + capabilities.latency_s + capabilities.jitter_s
    return speed.bound(look_s) + _unsure_m(capabilities)


def _unsure_m(capabilities: Capabilities) -> float:
    """Return by how much a place must be better than a module asks for: what noise and age take off its margin."""
    return _SLACK_M + capabilities.position_noise_m + capabilities.v_max_m_s * capabilities.sample_age_s


def _cost_per_m(mission: Mission, capabilities: Capabilities) -> float:
    return 1.0 / (mission.battery.drive_s * capabilities.v_max_m_s)


def _declare(
    mission: Mission,
    capabilities: Capabilities,
    terrain: Terrain,
    dock: Dock,
    ac: PortForwarder,
    waypoint: Topic[Any],
    recovery: RecoveryPlanner,
    right_of_way: RightOfWay,
    peer: SpeedBound,
    peer_noise_m: float,
) -> tuple[RTAModule, ...]:
    rta, tick_s = mission.rta, mission.base_tick_s
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    unsure_m = _unsure_m(capabilities)
    refuges = RefugeFinder(
        terrain,
        recovery,
        # Without the geofence a place outside is as good as one inside, and may be the only one in reach.
        rta.geofence.phi_safer_inset_m + unsure_m if GEOFENCE in enabled(mission) else -math.inf,
        rta.obstacle.phi_safer_m + unsure_m,
    )
    inside = Retreat("move-inside", tick_s, waypoint, recovery, refuges, _REFUGE_PEER_M)
    clear = Retreat("move-clear", tick_s, waypoint, recovery, refuges, _REFUGE_PEER_M)
    fence = Fence(0.0, terrain.width_m, 0.0, terrain.depth_m)
    drive_per_s = 1.0 / mission.battery.drive_s
    table = {
        COLLISION: lambda: RTAModule(
            COLLISION,
            ac,
            BackAway(tick_s, waypoint, recovery, refuges, right_of_way, dock),
            rta.collision.delta_s,
            Separation(rta.collision.phi_safe_m, peer.v_max_m_s, peer_noise_m),
            Separation(rta.collision.phi_safer_m, peer.v_max_m_s, peer_noise_m),
            PairBound(speed, peer),
            dwell_s=rta.collision.dwell_s,
        ),
        OBSTACLE: lambda: RTAModule(
            OBSTACLE,
            ac,
            clear,
            rta.obstacle.delta_s,
            Clearance(terrain, rta.obstacle.phi_safe_m),
            Clearance(terrain, rta.obstacle.phi_safer_m),
            speed,
            dwell_s=rta.obstacle.dwell_s,
        ),
        GEOFENCE: lambda: RTAModule(
            GEOFENCE,
            ac,
            inside,
            rta.geofence.delta_s,
            fence,
            fence.inset(rta.geofence.phi_safer_inset_m),
            speed,
            dwell_s=rta.geofence.dwell_s,
        ),
        BATTERY: lambda: RTAModule(
            BATTERY,
            ac,
            GoHome(tick_s, waypoint, recovery, dock),
            rta.battery.delta_s,
            ChargeForTheWayHome(dock, rta.battery.reserve_factor * dock.longest_m * dock.cost_per_m),
            Charged(rta.battery.phi_safer),
            DischargeBound(drive_per_s, capabilities.v_max_m_s, dock.cost_per_m, jump=dock.longest_m * dock.cost_per_m),
            dwell_s=rta.battery.dwell_s,
        ),
    }
    return tuple(table[name]() for name in enabled(mission))


def _monitored(modules: Sequence[RTAModule]) -> list[ReachModel]:
    """Return one model of each kind: the same speed bound need not be tested three times a tick."""
    seen: dict[type, ReachModel] = {}
    for module in modules:
        model: ReachModel | None = module.model
        if isinstance(model, PairBound):
            model = model.own
        if model is not None:
            seen.setdefault(type(model), model)
    return list(seen.values())
