"""Obstacle: the body of a robot stays clear of boxes."""

from __future__ import annotations

import math
from dataclasses import replace

from soter.config.tables import GeofenceTable, ObstacleTable
from soter.rta import RTAModule, SpeedBound, Timing
from soter.stack.module_kit import ModuleKit
from soter.stack.reach import reach_into
from soter.stack.recovery import RecoveryPlanner
from soter.stack.static_rules import Clearance


def keep_m(table: ObstacleTable, recovery: RecoveryPlanner, timing: Timing) -> float:
    """Return the module's `keep`: enough for a stopped robot to be where paths may begin.

    A module that fires leaves over what the unused part of its horizon would have cost; with a model that uses the
    present speed, nothing is left over.
    """
    return path_left_m(table, recovery, timing) if recovery.rules.boxes else 0.0


def path_left_m(table: ObstacleTable | GeofenceTable, recovery: RecoveryPlanner, timing: Timing) -> float:
    """Return the part of the room that paths need which is not left over when the module fires."""
    unused_s = timing.ahead_s(table.delta_s) - table.delta_s if table.model == "speed" else 0.0
    return max(0.0, recovery.path_m - recovery.v_max_m_s * unused_s)


def safer_m(table: ObstacleTable, recovery: RecoveryPlanner, timing: Timing, speed: SpeedBound) -> float:
    """Return the clearance of phi_safer: at least what the AC may use up plus what the safe controller needs.

    A phi_safer too small for what the AC may use up is left as it is; the module is then ill-formed.
    """
    trusted_m = speed.bound(timing.horizon_s(table.delta_s)) + timing.noise_m
    if not recovery.rules.boxes or table.phi_safer_m - table.phi_safe_m < trusted_m:
        return table.phi_safer_m
    return max(table.phi_safer_m, table.phi_safe_m + trusted_m + keep_m(table, recovery, timing))


def declare(kit: ModuleKit, table: ObstacleTable) -> RTAModule:
    """Declare the module of one robot.

    Raises:
        IllFormedModule: the robot does not promise what the motion model needs.
    """
    look_m = math.inf if kit.terrain.convex else kit.model.bound(kit.timing.horizon_s(table.delta_s))
    clearance = Clearance(kit.terrain, table.phi_safe_m, kit.recovery.path_m, kit.recovery.rules.fence, look_m)
    return RTAModule(
        kit.name,
        kit.ac,
        kit.retreat("move-clear"),
        table.delta_s,
        clearance,
        replace(clearance, least_m=safer_m(table, kit.recovery, kit.timing, kit.model)),
        reach_into(clearance, kit.motion(table.model)),
        dwell_s=table.dwell_s,
        keep=keep_m(table, kit.recovery, kit.timing),
    )
