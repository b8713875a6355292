"""Declares the enabled safety modules of one robot: from its promises alone, before there is a robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

from soter.config import Mission
from soter.config_tables import MotionModel
from soter.errors import IllFormedModule
from soter.rta import DischargeBound, Motion, RTAModule, Situation, SpeedBound, Timing, Topic
from soter.sdk import Capabilities, Link, RobotState
from soter.stack.actuator import PortForwarder
from soter.stack.battery import Charged, ChargeForTheWayHome, Dock, GoHome
from soter.stack.collision import BackAway, Separation, check_halves
from soter.stack.geofence import Fence
from soter.stack.obstacle import Clearance
from soter.stack.reach import Limits, reach_between, reach_into
from soter.stack.recovery import RecoveryPlanner, RecoveryRules
from soter.stack.refuge import RefugeFinder
from soter.stack.right_of_way import BATTERY, COLLISION, RightOfWay
from soter.stack.safe_controller import WAYPOINT, Retreat
from soter.stack.terrain import Point, Terrain
from soter.stack.user_modules import ModuleKit, declare_own
from soter.workspace import Workspace

OBSTACLE: Final = "obstacle"
GEOFENCE: Final = "geofence"

HOME_CLEARANCE_M: Final = 0.15
"""Body clearance that ways home keep from boxes at least."""

_SLACK_M: Final = 0.02
_REFUGE_PEER_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class PeerBounds:
    """What every robot of a fleet is assumed to respect: the worst that any of them promises.

    Attributes:
        v_max_m_s: top speed.
        brake_m_s2: deceleration.
        noise_m: error of a reported position.
        limits: whatever else bounds their motion.
    """

    v_max_m_s: float
    brake_m_s2: float
    noise_m: float
    limits: Limits

    @classmethod
    def of(cls, fleet: Sequence[Capabilities]) -> Self:
        """Return the bounds of a fleet."""
        return cls(
            max(each.v_max_m_s for each in fleet),
            min(each.brake_m_s2 for each in fleet),
            max(each.position_noise_m for each in fleet),
            Limits.of(*fleet),
        )


@dataclass(frozen=True)
class Declared:
    """The safety modules of one robot and what their safe controllers share.

    Attributes:
        modules: in order of their right to drive.
        recovery: makes and certifies the legs.
        refuges: finds where to retreat to.
        dock: the way home.
        start: where the robot starts.
        timing: what the robot adds to every horizon.
        own: the user's modules, those that are off included: their rules can be judged all the same.
    """

    modules: tuple[RTAModule, ...]
    recovery: RecoveryPlanner
    refuges: RefugeFinder
    dock: Dock
    start: Point
    timing: Timing
    own: tuple[RTAModule, ...] = ()

    def check(self, base_tick_s: float) -> None:
        """Check every module against the robot's promises.

        Raises:
            IllFormedModule: names the first module that fails, the condition, the numbers and a value that would do.
        """
        for module in self.modules:
            module.check(self.timing, base_tick_s)
            if module.name == BATTERY:
                self.dock.check_way_from(*self.start)
                self._check_station()
            if module.name == COLLISION:
                check_halves(module, self.timing, self.recovery.leg_m(self.timing.sample_age_s))

    def _check_station(self) -> None:
        """Check that no module with a better right to drive turns away a robot that stands at its station."""
        x_m, y_m = self.dock.place
        there = RobotState(0, 0.0, 0.0, x_m, y_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, None, None, Link.UP)
        situation = Situation(0, there, 0.0)
        for module in self.modules:
            if module.name == BATTERY:
                return
            if module.phi_safe is None or module.model is None:
                continue
            margin = module.phi_safe.margin(situation) - module.phi_safe.noise(self.timing.noise_m)
            reach = module.model.reach(situation, module.horizon_s(self.timing))
            if not margin >= reach:
                raise IllFormedModule(
                    BATTERY,
                    "P2b",
                    f"the charging station at ({x_m:g}, {y_m:g}) cannot be stood on: module '{module.name}' drives a "
                    f"robot away from there, whose margin is {margin:.3f} {module.phi_safe.unit} and may fall by "
                    f"{reach:.3f}; a station with a margin of {math.ceil(reach * 1000.0 - 1e-6) / 1000.0:.3f} "
                    f"{module.phi_safe.unit}, or a shorter Delta, would do",
                )


def timing_of(capabilities: Capabilities, base_tick_s: float) -> Timing:
    """Return what a robot adds to every horizon, ticked every `base_tick_s`."""
    return Timing(
        capabilities.latency_s, capabilities.sample_age_s, capabilities.jitter_s, capabilities.position_noise_m,
        capabilities.lease_s, base_tick_s,
    )  # fmt: skip


def enabled(mission: Mission) -> tuple[str, ...]:
    """Return the names of the enabled modules, in order of their right to drive: the highest that is in SC does."""
    return mission.rta.order


def declare(
    mission: Mission,
    workspace: Workspace,
    terrain: Terrain,
    robot_id: int,
    capabilities: Capabilities,
    peers: PeerBounds,
    ac: PortForwarder,
    waypoint: Topic[Any],
    right_of_way: RightOfWay,
) -> Declared:
    """Declare the enabled modules for one robot; nothing is checked yet.

    Args:
        mission: its `rta` and `battery` tables.
        workspace: where this robot charges.
        terrain: fence and boxes.
        robot_id: which robot.
        capabilities: what it promises.
        peers: what its peers are assumed to respect.
        ac: the forwarder of the AC's port.
        waypoint: the topic that AC and SCs share.
        right_of_way: the fleet's arbiter.
    """
    rta, tick_s = mission.rta, mission.base_tick_s
    recovery = RecoveryPlanner(
        terrain, capabilities, _rules(mission), mission.base_tick_s, peers.noise_m, peers.v_max_m_s
    )
    place = next(place for place in workspace.robots if place.id == robot_id)
    dock = Dock(
        terrain,
        place.charger,
        _home_clearance_m(mission, capabilities),
        _inset_m(mission, capabilities),
        _cost_per_m(mission, capabilities),
    )
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    limits = Limits.of(capabilities)
    motions: dict[MotionModel, Motion] = {"speed": speed}

    def motion(module: str, model: MotionModel) -> Motion:
        # One of each kind: a robot's samples are tested against each of them once, not once a module.
        if model not in motions:
            motions[model] = limits.motion(module, model)
        return motions[model]

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
    apart = Separation(rta.collision.phi_safe_m, peers.v_max_m_s, peers.noise_m)
    clearance = Clearance(terrain, rta.obstacle.phi_safe_m)
    drive_per_s = 1.0 / mission.battery.drive_s
    table = {
        COLLISION: lambda: RTAModule(
            COLLISION,
            ac,
            BackAway(tick_s, waypoint, recovery, refuges, right_of_way, dock, rta.collision.phi_safer_m),
            rta.collision.delta_s,
            apart,
            replace(apart, least_m=rta.collision.phi_safer_m),
            reach_between(
                apart, motion(COLLISION, rta.collision.model), peers.limits.motion(COLLISION, rta.collision.model)
            ),
            dwell_s=rta.collision.dwell_s,
        ),
        OBSTACLE: lambda: RTAModule(
            OBSTACLE,
            ac,
            clear,
            rta.obstacle.delta_s,
            clearance,
            replace(clearance, least_m=rta.obstacle.phi_safer_m),
            reach_into(clearance, motion(OBSTACLE, rta.obstacle.model)),
            dwell_s=rta.obstacle.dwell_s,
        ),
        GEOFENCE: lambda: RTAModule(
            GEOFENCE,
            ac,
            inside,
            rta.geofence.delta_s,
            fence,
            fence.inset(rta.geofence.phi_safer_inset_m),
            reach_into(fence, motion(GEOFENCE, rta.geofence.model)),
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
    timing = timing_of(capabilities, tick_s)
    own_modules = {}
    for name, own in mission.rta.module.items():
        kit = ModuleKit(
            name, robot_id, capabilities, workspace, terrain, ac, Topic(WAYPOINT), recovery, refuges, speed, timing,
            tick_s,
        )  # fmt: skip
        own_modules[name] = declare_own(mission, own, kit, waypoint)
    declared = tuple(own_modules[name] if name in own_modules else table[name]() for name in enabled(mission))
    return Declared(declared, recovery, refuges, dock, (place.x_m, place.y_m), timing, tuple(own_modules.values()))


def _rules(mission: Mission) -> RecoveryRules:
    names = enabled(mission)
    return RecoveryRules(
        fence=GEOFENCE in names,
        boxes=OBSTACLE in names,
        pairs=COLLISION in names,
        separation_m=mission.rta.collision.phi_safe_m,
    )


def _home_clearance_m(mission: Mission, capabilities: Capabilities) -> float:
    """Return what ways home keep from boxes: so much that the obstacle module, which goes first, does not step in."""
    if OBSTACLE not in enabled(mission):
        return HOME_CLEARANCE_M
    obstacle = mission.rta.obstacle
    speed = SpeedBound(capabilities.v_max_m_s, capabilities.brake_m_s2)
    ahead_s = timing_of(capabilities, mission.base_tick_s).ahead_s(obstacle.delta_s)
    reach_m = speed.bound(ahead_s + capabilities.latency_s + capabilities.jitter_s)
    return max(HOME_CLEARANCE_M, obstacle.phi_safe_m + reach_m + _unsure_m(capabilities))


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
