"""Declares the enabled safety modules of one robot: from its promises alone, before there is a robot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Self

from soter.config import MissionFile
from soter.config.tables import MotionModel, MotionTable
from soter.errors import IllFormedModule
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.rta import DischargeBound, Motion, PairBound, Region, RTAModule, SpeedBound, Timing, Topic
from soter.sdk import Capabilities
from soter.stack.actuator import PortForwarder
from soter.stack.battery import Charged, ChargeForTheWayHome, Dock, GoHome
from soter.stack.collision import BackAway, Separation, check_halves
from soter.stack.infrastructure import check_infrastructure
from soter.stack.own_rules import OwnRule, apart_m, forbidden
from soter.stack.reach import Limits, reach_between, reach_into
from soter.stack.recovery import RecoveryPlanner, RecoveryRules, extent_m
from soter.stack.refuge import RefugeFinder
from soter.stack.retreat import Retreat
from soter.stack.return_path import ReturnPath
from soter.stack.right_of_way import BATTERY, COLLISION, TURN_S, RightOfWay
from soter.stack.safe_controller import WAYPOINT
from soter.stack.site_routes import Rectangle
from soter.stack.site_terrain import terrain_of
from soter.stack.static_rules import Clearance, fence_of
from soter.stack.terrain import Terrain, grown
from soter.stack.user_modules import ModuleKit, declare_own

OBSTACLE: Final = "obstacle"
GEOFENCE: Final = "geofence"

HOME_CLEARANCE_M: Final = 0.15
"""Body clearance that ways home keep from boxes at least."""

_SLACK_M: Final = 0.02
_REFUGE_PEER_M: Final = 0.5

WAITING: Final = 2.0
"""Waiting costs so many times what standing does, but no more than driving: who waits makes room for others."""


@dataclass(frozen=True, slots=True)
class PeerBounds:
    """What every robot of a fleet is assumed to respect: the worst that any of them promises.

    Attributes:
        v_max_m_s: top speed.
        brake_m_s2: deceleration.
        noise_m: error of a reported position.
        sample_age_s: age of a sample.
        latency_s: the least until any of them acts on a command.
        extent_m: how far a leg of a safe controller may take any of them.
        limits: whatever else bounds their motion.
    """

    v_max_m_s: float
    brake_m_s2: float
    noise_m: float
    sample_age_s: float
    latency_s: float
    extent_m: float
    limits: Limits

    @classmethod
    def of(cls, fleet: Sequence[Capabilities], base_tick_s: float) -> Self:
        """Return the bounds of a fleet that is ticked every `base_tick_s`."""
        return cls(
            max(each.v_max_m_s for each in fleet),
            min(each.brake_m_s2 for each in fleet),
            max(each.position_noise_m for each in fleet),
            max(each.sample_age_s for each in fleet),
            min(each.latency_s for each in fleet),
            max(extent_m(each, base_tick_s) for each in fleet),
            Limits.of(*fleet),
        )


@dataclass(frozen=True, slots=True)
class Peers:
    """The other robots of a fleet, as one of them has to take them.

    Attributes:
        worst: what every robot respects, this one included.
        each: by other robot, what that one respects.
        speeds: how many of the others have each top speed, in m/s.
    """

    worst: PeerBounds
    each: Mapping[int, PeerBounds]
    speeds: Mapping[float, int]

    @classmethod
    def of(cls, robot_id: int, fleet: Mapping[int, Capabilities], base_tick_s: float) -> Self:
        """Return what a robot has to assume of a fleet, in which it is itself, ticked every `base_tick_s`."""
        others = {other: each for other, each in fleet.items() if other != robot_id}
        # Robots that promise the same are the same to it.
        known = {each: PeerBounds.of((each,), base_tick_s) for each in set(others.values())}
        return cls(
            PeerBounds.of([*fleet.values()], base_tick_s),
            {other: known[each] for other, each in others.items()},
            Counter(each.v_max_m_s for each in others.values()),
        )

    @property
    def unlike(self) -> Mapping[int, PeerBounds]:
        """The same as `each` where robots differ in what they respect; nothing where they are all alike."""
        return {} if all(each == self.worst for each in self.each.values()) else self.each


@dataclass(frozen=True)
class Declared:
    """The safety modules of one robot and what their safe controllers share.

    Attributes:
        modules: in order of their right to drive.
        recovery: makes and certifies the legs.
        refuges: finds where to retreat to.
        dock: the return path.
        place: where the robot starts and charges.
        others: the same of the other robots.
        peers: what those are assumed to respect.
        timing: what the robot adds to every horizon.
        own: the user's modules, those that are off included: their rules can be judged all the same.
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

    def module(self, name: str) -> RTAModule:
        """Return one of the modules by its name."""
        return next(module for module in self.modules if module.name == name)

    @cached_property
    def apart_m(self) -> float:
        """How far apart the user's rules about pairs give robots back, as far as asking them tells; 0 without any."""
        rules = [module.phi_safer for module in self.modules if module in self.own and module.of_pairs]
        return max((apart_m(rule, self.place) for rule in rules if isinstance(rule, Region)), default=0.0)

    def check(self, base_tick_s: float) -> None:
        """Check every module against the robot's promises.

        Raises:
            IllFormedModule: names the first module that fails, the condition, the numbers and a value that would do.
        """
        for module in self.modules:
            self.check_module(module, base_tick_s)
            if module.name == BATTERY:
                check_infrastructure(
                    self.place, self.others, self.dock.path, self.refuges, self.recovery, self.peers.worst.sample_age_s,
                    self.timing.noise_m,
                )  # fmt: skip

    def check_module(self, module: RTAModule, base_tick_s: float) -> None:
        """Check one module by itself against the robot's promises, the roads home left out.

        Raises:
            IllFormedModule: names the condition, the numbers and a value that would do.
        """
        module.check(self.timing, base_tick_s)
        if module.name == COLLISION:
            leg_m = self.recovery.leg_m(self.timing.sample_age_s)
            for peer in dict.fromkeys(self.peers.each.values()) or (self.peers.worst,):
                latency_s = min(self.timing.latency_s, peer.latency_s)
                check_halves(module, self.timing, leg_m, latency_s, SpeedBound(peer.v_max_m_s, peer.brake_m_s2))


def timing_of(capabilities: Capabilities, base_tick_s: float) -> Timing:
    """Return what a robot adds to every horizon, ticked every `base_tick_s`."""
    return Timing(
        capabilities.latency_s, capabilities.sample_age_s, capabilities.jitter_s, capabilities.position_noise_m,
        capabilities.lease_s, base_tick_s, speed_noise_m_s=capabilities.speed_noise_m_s,
    )  # fmt: skip


def terrains_of(workspace: Workspace, promised: Mapping[int, Capabilities]) -> dict[int, Terrain]:
    """Return fence and boxes for the body of each robot, by id; bodies that are alike share theirs."""
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
    waypoint: Topic[Any],
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
        ac: the forwarder of the AC's port.
        waypoint: the topic that AC and SCs share.
        right_of_way: the fleet's arbiter.
    """
    rta, tick_s, worst, unlike = mission.rta, mission.base_tick_s, peers.worst, peers.unlike
    rules = _rules(mission)
    # Safe controllers keep what the rule asks for beyond the body clear of boxes as if it were part of the body.
    beyond_m = rta.obstacle.phi_safe_m if rules.boxes else 0.0
    room = terrain_of(workspace, terrain.body_radius_m + beyond_m) if beyond_m else terrain
    recovery = RecoveryPlanner(
        room, capabilities, rules, tick_s, worst.noise_m, worst.v_max_m_s, worst.extent_m,
        {other: max(capabilities.v_max_m_s, peer.v_max_m_s) for other, peer in unlike.items()},
    )  # fmt: skip
    place = next(place for place in workspace.robots if place.id == robot_id)
    # Every station is reached with every other one occupied.
    apart_m = recovery.apart_m(worst.sample_age_s) if rules.pairs else 0.0
    occupied = [grown(Box(*each.charger.centre, *each.charger.centre), apart_m) for each in workspace.robots]
    stations = [
        edges for each, edges in zip(workspace.robots, occupied, strict=True) if apart_m and each.id != robot_id
    ]

    def path_around(more: Sequence[Rectangle]) -> ReturnPath:
        home_m, inset_m = _home_clearance_m(mission, capabilities) - beyond_m, _inset_m(mission, capabilities)
        return ReturnPath(room, recovery, place.charger.centre, home_m, inset_m, [*stations, *more])

    dock = Dock(place.charger, path_around(()), _cost_per_m(mission, capabilities))
    home = GoHome(tick_s, waypoint, recovery, dock)
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    limits = Limits.of(capabilities)
    motions: dict[MotionModel, Motion] = {"speed": speed}

    def motion(module: str, model: MotionModel) -> Motion:
        # One of each kind: a robot's samples are tested against each of them once, not once a module.
        if model not in motions:
            motions[model] = limits.motion(module, model)
        return motions[model]

    timing = timing_of(capabilities, tick_s)
    unsure_m = _unsure_m(capabilities)
    keep_m = _keep_m(mission, recovery, timing)
    # A refuge is where every static rule lets go: in phi_safer, and where the AC is trusted as well.
    clear_m = speed.bound(timing.horizon_s(rta.obstacle.delta_s)) + keep_m
    fence_keep_m = 0.0 if terrain.convex else _path_left_m(recovery, timing, rta.geofence, rta.geofence.delta_s)
    fence_m = speed.bound(timing.horizon_s(rta.geofence.delta_s))
    inside_m = fence_m + fence_keep_m
    fence = fence_of(terrain, fence_m)
    # What the AC may use up, and what the safe controller needs: phi_safer is no nearer than where both are left. A
    # phi_safer that does not even leave the first is ill-formed.
    trusted_m, safer_m = clear_m - keep_m + capabilities.position_noise_m, rta.obstacle.phi_safer_m
    if rules.boxes and safer_m - rta.obstacle.phi_safe_m >= trusted_m:
        safer_m = max(safer_m, rta.obstacle.phi_safe_m + trusted_m + keep_m)
    safer_inset_m = rta.geofence.phi_safer_inset_m
    if fence_keep_m and safer_inset_m >= fence_m + capabilities.position_noise_m:
        safer_inset_m = max(safer_inset_m, inside_m + capabilities.position_noise_m)
    refuges = RefugeFinder(
        room,
        recovery,
        # Without the geofence a place outside is as good as one inside, and may be the only one in reach.
        max(safer_inset_m, inside_m) + unsure_m if rules.fence else -math.inf,
        safer_m - beyond_m + unsure_m if rules.boxes else safer_m,
    )
    inside = Retreat("move-inside", tick_s, waypoint, recovery, refuges, _REFUGE_PEER_M, home, dock)
    clear = Retreat("move-clear", tick_s, waypoint, recovery, refuges, _REFUGE_PEER_M, home, dock)
    apart = Separation(rta.collision.phi_safe_m, worst.v_max_m_s, worst.noise_m)
    look_m = math.inf if terrain.convex else speed.bound(timing.horizon_s(rta.obstacle.delta_s))
    clearance = Clearance(terrain, rta.obstacle.phi_safe_m, recovery.path_m, rules.fence, look_m)
    drive_per_s = 1.0 / mission.battery.drive_s
    own_modules = {}
    for name, own in mission.rta.module.items():
        kit = ModuleKit(
            name, robot_id, capabilities, workspace, terrain, ac, Topic(WAYPOINT), recovery, refuges, dock,
            home, speed, SpeedBound(worst.v_max_m_s, worst.brake_m_s2), timing, tick_s,
        )  # fmt: skip
        own_modules[name] = made = declare_own(mission, own, kit, waypoint)
        _check_peer_model(made, worst)
    enforced = [own_modules[name] for name in mission.rta.order if name in own_modules]
    recovery.own_rules = [
        OwnRule(module.phi_safe, module.of_pairs) for module in enforced if module.phi_safe is not None
    ]
    if around := [
        each
        for rule in recovery.own_rules
        if not rule.of_pairs
        for each in forbidden(rule.region, place, room, recovery.path_m)
    ]:
        dock.path = path_around(around)
    # Each of the user's modules may keep a robot from going home for so long.
    contracts_s = sum(module.lets_go_s for module in enforced)
    table = {
        COLLISION: lambda: RTAModule(
            COLLISION,
            ac,
            BackAway(tick_s, waypoint, recovery, refuges, home, dock, right_of_way, rta.collision.phi_safer_m),
            rta.collision.delta_s,
            apart,
            replace(apart, least_m=rta.collision.phi_safer_m),
            reach_between(
                apart,
                motion(COLLISION, rta.collision.model),
                worst.limits.motion(COLLISION, rta.collision.model),
                {other: peer.limits.motion(COLLISION, rta.collision.model) for other, peer in unlike.items()},
            ),
            dwell_s=rta.collision.dwell_s,
        ),
        OBSTACLE: lambda: RTAModule(
            OBSTACLE,
            ac,
            clear,
            rta.obstacle.delta_s,
            clearance,
            replace(clearance, least_m=safer_m),
            reach_into(clearance, motion(OBSTACLE, rta.obstacle.model)),
            dwell_s=rta.obstacle.dwell_s,
            keep=keep_m,
        ),
        GEOFENCE: lambda: RTAModule(
            GEOFENCE,
            ac,
            inside,
            rta.geofence.delta_s,
            fence,
            fence.inset(safer_inset_m),
            reach_into(fence, motion(GEOFENCE, rta.geofence.model)),
            dwell_s=rta.geofence.dwell_s,
            keep=fence_keep_m,
        ),
        BATTERY: lambda: RTAModule(
            BATTERY,
            ac,
            home,
            rta.battery.delta_s,
            ChargeForTheWayHome(dock),
            Charged(rta.battery.phi_safer),
            DischargeBound(
                drive_per_s, capabilities.v_max_m_s, dock.cost_per_m, 2.0 * recovery.path_m * dock.cost_per_m
            ),
            dwell_s=rta.battery.dwell_s,
            keep=_reserve(mission, dock, peers.speeds if rules.pairs else {}, contracts_s),
        ),
    }
    declared = tuple(own_modules[name] if name in own_modules else table[name]() for name in mission.rta.order)
    others = tuple(each for each in workspace.robots if each.id != robot_id)
    return Declared(declared, recovery, refuges, dock, place, others, peers, timing, tuple(own_modules.values()))


def _check_peer_model(module: RTAModule, worst: PeerBounds) -> None:
    """Check that a module of the user's does not take its robot's peers for better than they are.

    Raises:
        IllFormedModule: names the figures, and what would do.
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


def _home_clearance_m(mission: MissionFile, capabilities: Capabilities) -> float:
    """Return what ways home keep from boxes: so much that the obstacle module, which goes first, does not step in."""
    if OBSTACLE not in mission.rta.order:
        return HOME_CLEARANCE_M
    obstacle = mission.rta.obstacle
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    reach_m = speed.bound(timing_of(capabilities, mission.base_tick_s).look_s(obstacle.delta_s))
    return max(HOME_CLEARANCE_M, obstacle.phi_safe_m + reach_m + _unsure_m(capabilities))


def _inset_m(mission: MissionFile, capabilities: Capabilities) -> float:
    """Return how near ways home may come to the fence: not so near that the geofence module would step in.

    Without that module robots may be anywhere on the open ground around the fence, and ways lead there too.
    """
    if GEOFENCE not in mission.rta.order:
        return -math.inf
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    look_s = timing_of(capabilities, mission.base_tick_s).look_s(mission.rta.geofence.delta_s)
    return speed.bound(look_s) + _unsure_m(capabilities)


def _keep_m(mission: MissionFile, recovery: RecoveryPlanner, timing: Timing) -> float:
    """Return what the obstacle module keeps so that a robot that was stopped is where paths are.

    A module that fires leaves what the unused part of its horizon would have cost; a model that looks at the present
    speed leaves nothing.
    """
    obstacle = mission.rta.obstacle
    return _path_left_m(recovery, timing, obstacle, obstacle.delta_s) if recovery.rules.boxes else 0.0


def _path_left_m(recovery: RecoveryPlanner, timing: Timing, module: MotionTable, delta_s: float) -> float:
    unused_s = timing.ahead_s(delta_s) - delta_s if module.model == "speed" else 0.0
    return max(0.0, recovery.path_m - recovery.v_max_m_s * unused_s)


def _reserve(mission: MissionFile, dock: Dock, others: Mapping[float, int], contracts_s: float) -> float:
    """Return the charge that is held back: for turns and detours, for others until they are home, and for contracts.

    Args:
        mission: its `rta` and `battery` tables.
        dock: of the robot.
        others: how many other robots have each top speed.
        contracts_s: the sum of the contracts of the user's modules.
    """
    battery = mission.battery
    others_s = sum(count * (dock.longest_m / v_max_m_s + TURN_S) for v_max_m_s, count in others.items())
    # Whoever waits also has to make room now and then.
    waiting = WAITING * others_s / min(battery.idle_s, WAITING * battery.drive_s)
    kept = contracts_s / battery.drive_s
    return mission.rta.battery.reserve_factor * dock.longest_m * dock.cost_per_m + waiting + kept


def _unsure_m(capabilities: Capabilities) -> float:
    """Return by how much a place must be better than a module asks for: what noise and age take off its margin."""
    return _SLACK_M + capabilities.position_noise_m + capabilities.v_max_m_s * capabilities.sample_age_s


def _cost_per_m(mission: MissionFile, capabilities: Capabilities) -> float:
    return 1.0 / (mission.battery.drive_s * capabilities.v_max_m_s)
