"""Proves P2 of the shipped modules from a workspace and from what robots promise, in milliseconds.

No states have to be enumerated. Every motion of a safe controller is certified when it is made, wherever the robot is
(docs/assurance.md); decision modules fire while the robot can still move; and it has a return path by construction.
What is left to prove is that the figures allow all this, and how long it takes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import Final

from soter.check.conditions import Certainty, Finding
from soter.config import MissionFile
from soter.errors import ceil_m
from soter.faults import read_faults
from soter.faults.vehicle import WheelSlipOptions
from soter.rta import Region, RTAModule
from soter.sdk import Capabilities
from soter.stack.declaration import GEOFENCE, OBSTACLE, Declared
from soter.stack.infrastructure import held_back, standing
from soter.stack.own_rules import broken_on
from soter.stack.return_path import DETOUR_M
from soter.stack.right_of_way import BATTERY, COLLISION
from soter.stack.terrain import length_m

_LOOKS: Final = 20
"""Number of places along the room, and across it, from which return paths are checked."""

_ORDER: Final = (Certainty.PROVED, Certainty.TESTED, Certainty.ASSUMED, Certainty.PARTLY, Certainty.REJECTED)


def prove(
    mission: MissionFile, declared: Mapping[int, Declared], capabilities: Mapping[int, Capabilities]
) -> list[Finding]:
    """Return findings about P2a and P2b of well-formed static modules and the battery's, each for the worst robot."""
    provers = {OBSTACLE: _retreat, GEOFENCE: _retreat, BATTERY: _way_home}
    findings: list[Finding] = []
    for name in mission.rta.order:
        prover = provers.get(name)
        if prover is not None:
            each = [
                prover(mission, made, capabilities[robot_id], made.module(name)) for robot_id, made in declared.items()
            ]
            findings += max(each, key=lambda found: max(_ORDER.index(one.verdict) for one in found))
    gaps = [*_crowded(mission, declared), *_blocked(mission, declared), *_forbidden(mission, declared)]
    unproved = {(gap.module, gap.condition) for gap in gaps}
    return [*(found for found in findings if (found.module, found.condition) not in unproved), *gaps]


def _crowded(mission: MissionFile, declared: Mapping[int, Declared]) -> list[Finding]:
    """Return a finding about P2b of the collision module if refuges are too few for all robots at once; else none.

    There has to be one place more than robots: if every place is taken, no robot can get past another.
    """
    others = len(next(iter(declared.values())).others)
    if COLLISION not in mission.rta.order or not others:
        return []
    apart_m = max(mission.rta.collision.phi_safer_m, *(each.apart_m for each in declared.values()))
    needed = others + 2
    room, refuges = min(
        (
            (each.refuges.room_for(needed, apart_m, each.dock.path.leads_back), each.refuges)
            for each in declared.values()
        ),
        key=lambda one: one[0],
    )
    if room == needed:
        return []
    text = (
        f"{room} places are found for {others + 1} robots, {apart_m:g} m apart, {max(refuges.fence_m, 0.0):.3f} m from "
        f"the fence and {refuges.clearance_m:.3f} m from boxes, where all modules give robots back and from where a "
        "path leads home; to get past each other robots need one place more than there are robots, else they may wait "
        "for ever; smaller phi_safer_m and phi_safer_inset_m, or fewer robots, would do"
    )
    return [Finding(COLLISION, "P2b", Certainty.PARTLY, text, {"robots": others + 1, "room": room})]


def _blocked(mission: MissionFile, declared: Mapping[int, Declared]) -> list[Finding]:
    """Return findings for several robots without the collision module, which makes them make way for each other."""
    others = len(next(iter(declared.values())).others)
    if COLLISION in mission.rta.order or not mission.rta.order or not others:
        return []
    # On the way to a station the battery's rule itself would break; otherwise the robot only stands.
    name, condition = (BATTERY, "P2a") if BATTERY in mission.rta.order else (mission.rta.order[-1], "P2b")
    text = (
        "without the module 'collision' no robot makes way, and a body that stands on a return path blocks it for ever "
        f"({others + 1} robots)"
    )
    return [Finding(name, condition, Certainty.PARTLY, text, {"robots": others + 1})]


def _forbidden(mission: MissionFile, declared: Mapping[int, Declared]) -> list[Finding]:
    """Return findings for user rules that a return path breaks, where a robot could wait until it is flat."""
    if BATTERY not in mission.rta.order:
        return []
    found = []
    for robot_id, made in declared.items():
        for module in made.modules:
            if module in made.own and not module.of_pairs and module.phi_safe is not None:
                found += _crossed(module.name, module.phi_safe, robot_id, made)
    return found


def _crossed(name: str, rule: Region, robot_id: int, made: Declared) -> list[Finding]:
    terrain, path = made.recovery.terrain, made.dock.path
    low_x, low_y, high_x, high_y = terrain.bounds
    for column, row in product(range(_LOOKS), range(_LOOKS)):
        place = low_x + (high_x - low_x) * (column + 0.5) / _LOOKS, low_y + (high_y - low_y) * (row + 0.5) / _LOOKS
        stands = min(terrain.clearance_m(*place), terrain.fence_m(*place)) >= 0.0 and not broken_on(
            rule, robot_id, [place, place]
        )
        if not stands or not path.leads_back(*place):
            continue
        if where := broken_on(rule, robot_id, [place, *path.legs(*place)]):
            text = (
                f"robot {robot_id}: it does not hold at ({where[0]:.2f}, {where[1]:.2f}), where the return path from "
                f"({place[0]:.2f}, {place[1]:.2f}) leads through: the robot could wait there until it is flat; a rule "
                "that leaves a way around it, or a box in the workspace, would do"
            )
            figures = {"robot": robot_id, "x_m": where[0], "y_m": where[1]}
            return [Finding(name, "P2c", Certainty.PARTLY, text, figures)]
    return []


def _retreat(mission: MissionFile, made: Declared, promised: Capabilities, module: RTAModule) -> list[Finding]:
    if premise := _premise(made, module.name, promised):
        return [premise]
    recovery, refuges, place = made.recovery, made.refuges, made.place
    # Without the battery's module nothing drives to the station.
    name, begin = ("station", made.dock.place) if BATTERY in mission.rta.order else ("start", (place.x_m, place.y_m))
    situation = standing(place.id, {place.id: begin})
    way = refuges.kept_way(situation, 0.0)
    if not way:
        held = held_back(refuges, recovery, situation, 0.0)
        own = f" and where the mission's own rules give it back: {held}" if held else ""
        text = (
            f"robot {place.id} never gets back to its AC: from its {name} at ({begin[0]:g}, {begin[1]:g}) no place can "
            f"be reached that is {ceil_m(max(refuges.fence_m, 0.0))} m from the fence and "
            f"{ceil_m(refuges.clearance_m)} m from boxes{own}; a smaller phi_safer_inset_m or phi_safer_m would do"
        )
        return [Finding(module.name, "P2b", Certainty.REJECTED, text)]
    way_m = length_m([begin, *way])
    home_m = made.dock.longest_m
    back_s = (way_m + home_m) / promised.v_max_m_s + 2.0 * _start_s(mission, promised) + module.dwell_s + module.delta_s
    figures = {"path_m": recovery.path_m, "keep": module.keep, "way_m": way_m, "home_m": home_m}
    stays = (
        f"one robot: every leg and hold is certified; it is left where paths fit, which keep {recovery.path_m:.3f} m"
    )
    returns = (
        f"one robot: where no refuge is in sight the return path, of {home_m:.2f} m where the roadmap shows one, and "
        f"{way_m:.2f} m from the {name} lead to one; {back_s:.0f} s at the declared speeds"
    )
    return [
        Finding(module.name, "P2a", Certainty.PROVED, stays, figures),
        Finding(module.name, "P2b", Certainty.PROVED, returns, figures),
    ]


def _way_home(mission: MissionFile, made: Declared, promised: Capabilities, module: RTAModule) -> list[Finding]:
    if premise := _premise(made, module.name, promised):
        return [premise]
    battery, dock, robot_id = mission.battery, made.dock, made.place.id
    legs, leg_s, part = dock.path.most_legs, _leg_s(mission, promised), _grip(mission, made)
    longest_s = dock.longest_m / promised.v_max_m_s
    # Beyond driving at the declared speed: coming to rest and turning at every corner, and wheel slip.
    extra = (legs * leg_s / part + longest_s * (1.0 / part - 1.0)) / battery.drive_s
    home_s = (legs * leg_s + longest_s) / part
    figures = {"longest_m": dock.longest_m, "legs": legs, "extra": extra, "reserve": module.keep}
    if extra > module.keep:
        more = (extra - module.keep) / (dock.longest_m * dock.cost_per_m)
        factor = math.ceil((mission.rta.battery.reserve_factor + more) * 10) / 10
        slips = f", and wheels that leave {100 * part:.0f} % of the speed," if part < 1.0 else ""
        text = (
            f"robot {robot_id}: {legs} turns on the return path{slips} use up to {100 * extra:.2f} % of a charge, more "
            f"than the reserve of {100 * module.keep:.2f} %; reserve_factor = {factor:g} would do"
        )
        return [Finding(BATTERY, "P2a", Certainty.REJECTED, text, figures)]
    # If others may be in the way from the very beginning, waiting for them takes the whole reserve.
    if short := _starts_low(mission, made, promised, module.keep if made.others else extra):
        return [short]
    others = len(made.others)
    waiting = f"; waiting for {others} other{'s'[: others != 1]} is tested, not proved" if others else ""
    stays = (
        f"robot {robot_id}: it always has a return path that is paid for, and the reserve of {100 * module.keep:.1f} % "
        f"pays for {legs} turns ({100 * extra:.2f} %){waiting}"
    )
    returns = (
        f"robot {robot_id}: home in {home_s:.0f} s from as far as the roadmap reaches, at the declared speeds, and "
        f"charged in {battery.charge_s:g} s"
    )
    return [
        Finding(BATTERY, "P2a", Certainty.PROVED, stays, figures),
        Finding(BATTERY, "P2b", Certainty.PROVED, returns, figures),
    ]


def _premise(made: Declared, name: str, promised: Capabilities) -> Finding | None:
    """Return why a robot's promises cannot support a proof, or None."""
    if promised.overshoot_m <= promised.tube_m:
        return None
    text = (
        f"robot {made.place.id} overshoots by {promised.overshoot_m:g} m, more than its tube of {promised.tube_m:g} m, "
        "for which every leg is certified"
    )
    return Finding(name, "P2a", Certainty.REJECTED, text)


def _start_s(mission: MissionFile, promised: Capabilities) -> float:
    """Return how long it takes to come to rest, look, and turn."""
    turn_s = (math.pi / 2.0 if promised.reverses else math.pi) / promised.yaw_rate_max_rad_s
    return promised.latency_s + promised.v_max_m_s / promised.brake_m_s2 + mission.base_tick_s + turn_s


def _leg_s(mission: MissionFile, promised: Capabilities) -> float:
    """Return the time of a leg beyond driving its length at the declared speed: to stop, look, turn, speed up."""
    v_max_m_s, accel_m_s2 = promised.v_max_m_s, promised.accel_m_s2
    speed_up_s = v_max_m_s / promised.brake_m_s2
    return _start_s(mission, promised) + max(speed_up_s, v_max_m_s / (2.0 * accel_m_s2) if accel_m_s2 else 0.0)


def _grip(mission: MissionFile, made: Declared) -> float:
    """Return the part of a robot's speed that its declared wheel slip leaves."""
    return math.prod(
        min(table.options.left, table.options.right)
        for table in read_faults(mission, [each.id for each in (made.place, *made.others)])
        if table.hits(made.place.id) and isinstance(table.options, WheelSlipOptions) and table.options.declared
    )


def _starts_low(mission: MissionFile, made: Declared, promised: Capabilities, reserve: float) -> Finding | None:
    """Return a finding if the initial charge that the mission gives a robot cannot pay for its return path, or None."""
    place, dock = made.place, made.dock
    charge = mission.initial_charge(place.id)
    way_m = dock.path.shortest_m(place.x_m, place.y_m) + DETOUR_M
    needed = way_m * dock.cost_per_m + reserve
    if charge >= needed or not (promised.in_process or place.id in (mission.battery.initial or {})):
        return None
    waiting = " and waiting for others" if made.others else ""
    text = (
        f"robot {place.id} starts with a charge of {charge:.4f}, and its way home of {way_m:.2f} m, with what "
        f"turns{waiting} may take, uses up to {needed:.4f}; "
        f"battery.initial.{place.id} = {math.ceil(needed * 1000) / 1000:g} would do"
    )
    return Finding(BATTERY, "P2a", Certainty.REJECTED, text, {"charge": charge, "needed": needed})
