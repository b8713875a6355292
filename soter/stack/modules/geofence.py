"""Geofence: the centre of a robot stays inside the fence."""

from __future__ import annotations

from soter.config.tables import GeofenceTable
from soter.rta import RTAModule
from soter.stack.module_kit import ModuleKit
from soter.stack.reach import reach_into
from soter.stack.static_rules import Fence


def declare(kit: ModuleKit, table: GeofenceTable) -> RTAModule:
    """Declare the module of one robot.

    Args:
        kit: the robot and its world.
        table: `[rta.geofence]`.

    Raises:
        IllFormedModule: the robot does not promise what the motion model needs.
    """
    fence = Fence(0.0, kit.terrain.width_m, 0.0, kit.terrain.depth_m)
    return RTAModule(
        kit.name,
        kit.ac,
        kit.retreat("move-inside"),
        table.delta_s,
        fence,
        fence.inset(table.phi_safer_inset_m),
        reach_into(fence, kit.motion(table.model)),
        dwell_s=table.dwell_s,
    )
