"""Battery: the charge always pays for the return path."""

from __future__ import annotations

from typing import Final

from soter.config.tables import BatteryModuleTable
from soter.rta import DischargeBound, RTAModule
from soter.stack.battery import Charged, ChargeForTheWayHome
from soter.stack.module_kit import ModuleKit
from soter.stack.right_of_way import TURN_S

WAITING: Final = 2.0
"""Waiting costs this many times what standing does, at most what driving does: waiting robots also make room."""


def declare(kit: ModuleKit, table: BatteryModuleTable) -> RTAModule:
    """Declare the module of one robot."""
    dock, v_max_m_s = kit.dock, kit.capabilities.v_max_m_s
    tube = 2.0 * kit.recovery.path_m * dock.cost_per_m
    paid = ChargeForTheWayHome(dock)
    remedies = [f"a larger battery.drive_s{' and battery.idle_s' * (kit.shut_in_by > 0)}"]
    if table.reserve_factor > 1.0:
        remedies.append("a smaller rta.battery.reserve_factor")
    if kit.shut_in_by:
        remedies.append(
            f"a smaller battery.charge_s, for which the robot waits where {kit.shut_in_by} occupied "
            f"station{'s' * (kit.shut_in_by > 1)} may shut it in, or stations that leave a path between them"
        )
    return RTAModule(
        kit.name,
        kit.ac,
        kit.home,
        table.delta_s,
        paid,
        Charged(table.phi_safer),
        DischargeBound(1.0 / kit.battery.drive_s, v_max_m_s, dock.cost_per_m, tube),
        dwell_s=table.dwell_s,
        keep=_reserve(kit, table),
        # The charge is at most 1.
        most_edge=paid.edge_margin(Charged(1.0)),
        instead=", or ".join(remedies) + "," * (len(remedies) > 1),
    )


def _reserve(kit: ModuleKit, table: BatteryModuleTable) -> float:
    """Return the reserve: the charge for turns and detours, for waiting for other robots, and for contracts."""
    battery, dock = kit.battery, kit.dock
    others = kit.peers.speeds if kit.recovery.rules.pairs else {}
    others_s = sum(count * (dock.longest_m / v_max_m_s + TURN_S) for v_max_m_s, count in others.items())
    # Past a station that shuts it in, a robot may have to wait until the one that has just come there is charged.
    others_s += kit.shut_in_by * table.phi_safer * battery.charge_s
    # A robot that waits also has to make room now and then.
    waiting = WAITING * others_s / min(battery.idle_s, WAITING * battery.drive_s)
    return table.reserve_factor * dock.longest_m * dock.cost_per_m + waiting + kit.contracts_s / battery.drive_s
