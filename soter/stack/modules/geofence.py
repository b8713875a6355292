"""Geofence: the centre of a robot stays inside the fence."""

from __future__ import annotations

from soter.config.tables import GeofenceTable
from soter.rta import RTAModule, SpeedBound, Timing
from soter.stack.module_kit import ModuleKit
from soter.stack.modules.obstacle import path_left_m
from soter.stack.reach import reach_into
from soter.stack.recovery import RecoveryPlanner
from soter.stack.static_rules import fence_of


def keep_m(table: GeofenceTable, recovery: RecoveryPlanner, timing: Timing) -> float:
    """Return the module's `keep`: enough for a stopped robot to be where paths may begin.

    In a rectangle it is 0: straight inwards leads away from whichever side is too near.
    """
    return 0.0 if recovery.terrain.convex else path_left_m(table, recovery, timing)


def safer_inset_m(table: GeofenceTable, recovery: RecoveryPlanner, timing: Timing, speed: SpeedBound) -> float:
    """Return the inset of phi_safer: at least what the AC may use up plus what the safe controller needs.

    A phi_safer too small for what the AC may use up is left as it is; the module is then ill-formed.
    """
    trusted_m = speed.bound(timing.horizon_s(table.delta_s)) + timing.noise_m
    if table.phi_safer_inset_m < trusted_m:
        return table.phi_safer_inset_m
    kept_m = keep_m(table, recovery, timing)
    return max(table.phi_safer_inset_m, trusted_m + kept_m) if kept_m else table.phi_safer_inset_m


def declare(kit: ModuleKit, table: GeofenceTable) -> RTAModule:
    """Declare the module of one robot.

    Raises:
        IllFormedModule: the robot does not promise what the motion model needs.
    """
    fence = fence_of(kit.terrain, kit.model.bound(kit.timing.horizon_s(table.delta_s)))
    return RTAModule(
        kit.name,
        kit.ac,
        kit.retreat("move-inside"),
        table.delta_s,
        fence,
        fence.inset(safer_inset_m(table, kit.recovery, kit.timing, kit.model)),
        reach_into(fence, kit.motion(table.model)),
        dwell_s=table.dwell_s,
        keep=keep_m(table, kit.recovery, kit.timing),
    )
