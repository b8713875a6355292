"""Declares the enabled safety modules of one robot, from its promises alone, before the robot exists."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Final

from soter.config import MissionFile
from soter.errors import IllFormedModule
from soter.geometry.workspace import RobotPlace, Workspace
from soter.rta import PairBound, Region, RTAModule, SpeedBound, Timing, Topic
from soter.rta.module import plain
from soter.sdk import Capabilities
from soter.stack.actuator import PortForwarder
from soter.stack.battery import Dock, GoHome
from soter.stack.infrastructure import check_infrastructure, check_start, occupied, room_at, shut_in_by
from soter.stack.module_kit import ModuleKit
from soter.stack.modules import declare_module, geofence, obstacle
from soter.stack.own_rules import OwnRule, apart_m, forbidden
from soter.stack.peers import PeerBounds, Peers
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.refuge import RefugeFinder
from soter.stack.return_path import BACK_CHARGE, BACK_M, ReturnPath
from soter.stack.right_of_way import BATTERY, COLLISION, RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.site_routes import Rectangle
from soter.stack.site_terrain import terrain_of
from soter.stack.terrain import Terrain

OBSTACLE: Final = "obstacle"
GEOFENCE: Final = "geofence"

HOME_CLEARANCE_M: Final = 0.15
"""Least body clearance of return paths from boxes."""

_SLACK_M: Final = 0.02


@dataclass(frozen=True)
class Declared:
    """The safety modules of one robot and what their safe controllers share.

    Attributes:
        modules: in order of priority.
        recovery: makes and certifies the legs.
        refuges: finds where to retreat to.
        dock: the charging station and the return path to it.
        place: where the robot starts and charges.
        others: where the other robots start and charge.
        peers: what the other robots are assumed to respect.
        timing: what the robot adds to every horizon.
        own: the user's modules, also those that are off, whose rules can still be judged.
        apart_m: distance at which the user's rules about pairs give robots back, found by probing them; 0 without any.
    """

    modules: tuple[RTAModule, ...]
    recovery: RecoveryPlanner
    refuges: RefugeFinder
    dock: Dock
    place: RobotPlace
    others: tuple[RobotPlace, ...]
    peers: Peers
    timing: Timing
    own: tuple[RTAModule, ...] = ()
    apart_m: float = 0.0

    def module(self, name: str) -> RTAModule:
        """Return one of the modules by its name."""
        return next(module for module in self.modules if module.name == name)

    def check(self, base_tick_s: float) -> None:
        """Check every module against the robot's promises.

        Raises:
            IllFormedModule: names the first module that fails, the condition, the numbers and a value that would do.
        """
        for module in self.modules:
            module.check(self.timing, base_tick_s)
        check_start(self.place, self.recovery)
        if any(module.name == BATTERY for module in self.modules):
            check_infrastructure(
                self.place, self.others, self.dock.path, self.refuges, self.recovery, self.peers.worst.sample_age_s,
                self.timing.noise_m,
            )  # fmt: skip


def timing_of(capabilities: Capabilities, base_tick_s: float) -> Timing:
    """Return what a robot adds to every horizon, ticked every `base_tick_s`."""
    return Timing(
        capabilities.latency_s, capabilities.sample_age_s, capabilities.jitter_s, capabilities.position_noise_m,
        capabilities.lease_s, base_tick_s, speed_noise_m_s=capabilities.speed_noise_m_s,
    )  # fmt: skip


def terrains_of(workspace: Workspace, promised: Mapping[int, Capabilities]) -> dict[int, Terrain]:
    """Return the terrain for the body of each robot, by id; bodies of one size share a terrain."""
    known = {
        radius_m: terrain_of(workspace, radius_m) for radius_m in {each.body_radius_m for each in promised.values()}
    }
    return {robot_id: known[each.body_radius_m] for robot_id, each in promised.items()}


def declare(
    mission: MissionFile,
    workspace: Workspace,
    terrain: Terrain,
    robot_id: int,
    capabilities: Capabilities,
    peers: Peers,
    ac: PortForwarder,
    right_of_way: RightOfWay,
) -> Declared:
    """Declare the enabled modules for one robot; nothing is checked yet.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: where this robot charges.
        terrain: fence and boxes, for the body of this robot.
        robot_id: which robot.
        capabilities: what it promises.
        peers: what its peers are assumed to respect.
        ac: the forwarder of the AC's port; safe controllers share its topic.
        right_of_way: the fleet's arbiter.
    """
    rta, tick_s, worst = mission.rta, mission.base_tick_s, peers.worst
    rules = _rules(mission)
    # Safe controllers treat the clearance that the rule asks for as part of the body.
    beyond_m = rta.obstacle.phi_safe_m if rules.boxes else 0.0
    room = terrain_of(workspace, terrain.body_radius_m + beyond_m) if beyond_m else terrain
    recovery = RecoveryPlanner(
        room, capabilities, rules, tick_s, worst.noise_m, worst.v_max_m_s, worst.extent_m,
        {other: max(capabilities.v_max_m_s, peer.v_max_m_s) for other, peer in peers.unlike.items()},
    )  # fmt: skip
    place = next(place for place in workspace.robots if place.id == robot_id)
    # Every station can be reached while all others are occupied.
    beside_m = recovery.apart_m(worst.sample_age_s) if rules.pairs else 0.0
    others = tuple(each for each in workspace.robots if each.id != robot_id)
    stations = [occupied(each.charger.centre, beside_m, place.charger.centre) for each in others] if beside_m else []

    rooms = tuple(room_at(each.charger.centre, beside_m) for each in workspace.robots) if beside_m else ()

    timing = timing_of(capabilities, tick_s)

    def path_around(more: Sequence[Rectangle], stations: Sequence[Sequence[Rectangle]] = stations) -> ReturnPath:
        kept_m = obstacle.keep_m(rta.obstacle, recovery, timing), geofence.keep_m(rta.geofence, recovery, timing)
        home_m = _home_clearance_m(mission, capabilities, kept_m[0]) - beyond_m
        inset_m = _inset_m(mission, capabilities, kept_m[1])
        kept_free, shared = [*chain(*stations), *more], rooms if stations else ()
        back_m = max(BACK_M, BACK_CHARGE / cost_per_m)
        return ReturnPath(room, recovery, place.charger.centre, home_m, inset_m, kept_free, shared, back_m)

    cost_per_m = 1.0 / (mission.battery.drive_s * capabilities.v_max_m_s)
    dock = Dock(place.charger, path_around(()), cost_per_m)
    kit = ModuleKit(
        "", robot_id, capabilities, workspace, terrain, ac, Topic(WAYPOINT), recovery,
        _refuges(mission, capabilities, room, recovery, timing), dock, GoHome(tick_s, ac.waypoint, recovery, dock),
        SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2), peers, right_of_way, mission.battery, timing,
        tick_s,
    )  # fmt: skip

    def made(name: str) -> RTAModule:
        return declare_module(mission, replace(kit, name=name, waypoint=Topic(WAYPOINT)), ac.waypoint)

    own = {name: made(name) for name in rta.module}
    for module in own.values():
        _check_peer_model(module, worst)
    enforced = [own[name] for name in rta.order if name in own]
    recovery.own_rules = [_own_rule(module, timing) for module in enforced if module.phi_safe is not None]
    around = [
        each
        for rule in recovery.own_rules
        if not rule.of_pairs
        for each in forbidden(rule.region, place, room, recovery.path_m)
    ]
    if around:
        dock.path = path_around(around)
        kit.refuges.around = around
    # Each of the user's modules may keep a robot from going home for its `lets_go_s`.
    safer = [module.phi_safer for module in enforced if module.of_pairs]
    pairs_m = max((apart_m(rule, place) for rule in safer if isinstance(rule, Region)), default=0.0)
    shut_in = shut_in_by(dock.path, partial(path_around, around, ()), stations) if BATTERY in rta.order else 0
    kit = replace(kit, contracts_s=sum(module.lets_go_s for module in enforced), pairs_m=pairs_m, shut_in_by=shut_in)
    modules = tuple(own[name] if name in own else made(name) for name in rta.order)
    return Declared(modules, recovery, kit.refuges, dock, place, others, peers, timing, tuple(own.values()), pairs_m)


def _own_rule(module: RTAModule, timing: Timing) -> OwnRule:
    assert module.phi_safe is not None
    try:
        noise = plain(module.phi_safe.noise(timing.noise_m))
        reach = plain(module.model.bound(module.horizon_s(timing))) if module.model is not None else 0.0
    except KeyboardInterrupt:
        raise
    except BaseException:  # noqa: BLE001 - foreign code; the module's check fails as well, and says why
        noise = reach = 0.0
    safer = module.phi_safer if isinstance(module.phi_safer, Region) else None
    return OwnRule(module.phi_safe, module.of_pairs, safer, noise, noise + reach, module.name)


def _refuges(
    mission: MissionFile, capabilities: Capabilities, room: Terrain, recovery: RecoveryPlanner, timing: Timing
) -> RefugeFinder:
    """Return the finder of refuges: places in the static rules' phi_safer where the AC is trusted for a horizon."""
    rta, rules, unsure_m = mission.rta, recovery.rules, _unsure_m(capabilities)
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    inside_m = speed.bound(timing.horizon_s(rta.geofence.delta_s)) + geofence.keep_m(rta.geofence, recovery, timing)
    safer_inset_m = geofence.safer_inset_m(rta.geofence, recovery, timing, speed)
    clear_m = obstacle.safer_m(rta.obstacle, recovery, timing, speed)
    return RefugeFinder(
        room,
        recovery,
        # Without the geofence module a place outside will do as well, and may be the only one in reach.
        max(safer_inset_m, inside_m) + unsure_m if rules.fence else -math.inf,
        clear_m - rta.obstacle.phi_safe_m + unsure_m if rules.boxes else clear_m,
    )


def _check_peer_model(module: RTAModule, worst: PeerBounds) -> None:
    """Check that a user's module does not assume more of its robot's peers than they promise.

    Raises:
        IllFormedModule: it does; names the figures, and what would do.
    """
    model = module.model
    if not isinstance(model, PairBound):
        return
    v_max_m_s, brake_m_s2 = model.other.v_max_m_s, model.other.brake_m_s2
    if v_max_m_s < worst.v_max_m_s or brake_m_s2 > worst.brake_m_s2:
        raise IllFormedModule(
            module.name, "P3",
            f"its model has peers that do {v_max_m_s:g} m/s and brake at {brake_m_s2:g} m/s2, but the robots promise "
            f"{worst.v_max_m_s:g} m/s and {worst.brake_m_s2:g} m/s2; kit.peer_model would do",
        )  # fmt: skip


def _rules(mission: MissionFile) -> RecoveryRules:
    names = mission.rta.order
    return RecoveryRules(
        fence=GEOFENCE in names,
        boxes=OBSTACLE in names,
        pairs=COLLISION in names,
        separation_m=mission.rta.collision.phi_safe_m,
    )


def _home_clearance_m(mission: MissionFile, capabilities: Capabilities, keep_m: float) -> float:
    """Return how far return paths keep from boxes: enough for the obstacle module, which goes first, not to fire.

    Else its safe controller turns back to where the path has that room, and the battery's on again, for ever.

    Args:
        mission: its `rta` table.
        capabilities: what the robot promises.
        keep_m: the module's `keep`.
    """
    if OBSTACLE not in mission.rta.order:
        return HOME_CLEARANCE_M
    table = mission.rta.obstacle
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    reach_m = speed.bound(timing_of(capabilities, mission.base_tick_s).look_s(table.delta_s))
    return max(HOME_CLEARANCE_M, table.phi_safe_m + reach_m + keep_m + _unsure_m(capabilities))


def _inset_m(mission: MissionFile, capabilities: Capabilities, keep_m: float) -> float:
    """Return how near return paths may come to the fence without the geofence module, with its `keep`, firing.

    Without that module robots may be anywhere on the open ground around the fence, and return paths lead there too.
    """
    if GEOFENCE not in mission.rta.order:
        return -math.inf
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    look_s = timing_of(capabilities, mission.base_tick_s).look_s(mission.rta.geofence.delta_s)
    return speed.bound(look_s) + keep_m + _unsure_m(capabilities)


def _unsure_m(capabilities: Capabilities) -> float:
    """Return how much margin noise and sample age may cost a place, which must exceed a module's demand by as much."""
    return _SLACK_M + capabilities.position_noise_m + capabilities.v_max_m_s * capabilities.sample_age_s
