"""From a seed to a configuration: a mission and its room, over everything that a mission file can say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pkgutil import resolve_name
from random import Random
from typing import Any, Final

from soter.campaign.random.acs import draw_ac
from soter.campaign.random.configuration import Configuration, Tables
from soter.campaign.random.faults import draw_faults
from soter.campaign.random.figures import Figures, worst
from soter.campaign.random.floor import Floor, draw_floor
from soter.campaign.random.modules import draw_rta
from soter.campaign.random.places import Needs, furnish
from soter.faults import BUILT_IN as FAULT_KINDS
from soter.faults import Fault, FaultOptions
from soter.faults.fault import Context
from soter.faults.robot import widened
from soter.geometry.workspace import Workspace
from soter.registry import load_backend
from soter.sdk import Capabilities

NASTY: Final = 0.45
"""Part of the configurations that are drawn at the edges of what is valid."""

DURATION_S: Final = (600.0, 1200.0)
MOST_ROBOTS: Final = 10

_TICKS: Final = (0.05, 0.05, 0.05, 0.05, 0.1)
_ODD_TICKS: Final = (0.01, 0.02, 0.025, 0.04, 0.15, 0.2)
_HOME_M: Final = 0.15
_SLACK_M: Final = 0.03


def draw(seed: int, engine: str = "kinematic") -> Configuration:
    """Return the configuration of a seed; the same seed gives the same one.

    Args:
        seed: any whole number.
        engine: of the backend `pybullet`; with `kinematic` half of the missions name the backend of that name.
    """
    rng = Random(f"configuration {seed}")
    nasty = rng.random() < NASTY
    while True:
        found = _drawn(rng, nasty, engine)
        if found is not None:
            return found


def _drawn(rng: Random, nasty: bool, engine: str) -> Configuration | None:
    """Return a configuration, or None where no robot fits into the room that was drawn."""
    floor = draw_floor(rng, nasty)
    tables: Tables = {"seed": rng.randrange(2**31), "duration_s": round(rng.uniform(*DURATION_S), 1)}
    chance = rng.random()
    if engine == "kinematic" and chance < 0.3:
        tables["backend"] = "kinematic"
    elif engine == "kinematic" and chance < 0.65:
        tables["backend"], tables["backends"] = "kinematic", {"kinematic": {"promise": _robot(rng, nasty)}}
    else:
        tables["backend"], tables["backends"] = "pybullet", {"pybullet": {"engine": engine}}
    tick_s = rng.choice(_ODD_TICKS if nasty and rng.random() < 0.4 else _TICKS)
    if tick_s != 0.05 or rng.random() < 0.1:
        tables["base_tick_s"] = tick_s
    wanted = min(rng.choices(range(1, MOST_ROBOTS + 1), (20, 22, 14, 12, 8, 7, 6, 5, 4, 4))[0], _room_for(floor, nasty))
    faults = draw_faults(rng, range(1, wanted + 1), nasty)
    figures = Figures(_promised(tables, faults, wanted, tick_s), tick_s)
    rta = draw_rta(rng, floor, figures, nasty)
    needs = Needs(
        fence=figures.spare_m(rta.geofence_delta_s) + _SLACK_M + figures.promise.v_max_m_s * 0.05,
        boxes=figures.promise.body_radius_m + max(_HOME_M, rta.obstacle_safe_m + rta.obstacle_reach_m) + _SLACK_M,
        spot=figures.promise.body_radius_m + rta.obstacle_safer_m + 0.05,
        apart=rta.apart_m * (1.0 if nasty else rng.uniform(1.0, 1.5)),
        passing=rta.passing_m,
    )
    if nasty and rng.random() < 0.3:
        needs = Needs(0.05, figures.promise.body_radius_m + 0.05, needs.spot, needs.apart, needs.passing)
    room = furnish(rng, floor, wanted, needs, nasty)
    if room is None:
        return None
    ids = [start.id for start in room.robots]
    faults = [fault for fault in faults if fault.get("robot", "all") in ("all", *ids)]
    if len(ids) > 1 and rng.random() < 0.05:
        kept = rng.randint(1, len(ids))
        if all(fault.get("robot", "all") in ("all", *ids[:kept]) for fault in faults):
            tables["robots"] = kept
            ids = ids[:kept]
    rta.with_own_modules(rng, room, figures, nasty)
    tables["rta"] = rta.table
    tables["battery"] = _battery(rng, floor, figures, rta.battery, ids, nasty)
    tables.update(draw_ac(rng, room, figures, rta, nasty))
    if faults:
        tables["fault"] = faults
    return Configuration({key: value for key, value in tables.items() if value != {}}, room)


def _room_for(floor: Floor, nasty: bool) -> int:
    """Return about how many robots there is room for."""
    boxes = sum((box.high_x - box.low_x) * (box.high_y - box.low_y) for box in floor.boxes)
    return max(1, int((floor.width * floor.depth - boxes) / (0.6 if nasty else 1.2)))


def _robot(rng: Random, nasty: bool) -> Tables:
    """Return what robots promise: slow ones, weak brakes, late samples, large bodies; some of them."""
    scale = 1.0 if nasty else 0.5
    figures = {
        "v_max_m_s": 0.22 - rng.uniform(0.0, 0.18 if nasty else 0.14),
        "brake_m_s2": 1.0 - rng.uniform(0.0, 0.85) * scale,
        "latency_s": 0.05 + rng.uniform(0.0, 0.2) * scale,
        "sample_age_s": rng.uniform(0.0, 0.2) * scale,
        "jitter_s": rng.uniform(0.0, 0.1) * scale,
        "position_noise_m": rng.uniform(0.0, 0.1) * scale,
        "tube_m": 0.02 + rng.uniform(0.0, 0.08) * scale,
        "body_radius_m": 0.105 + rng.uniform(0.0, 0.2) * scale,
    }
    kept = rng.sample([*figures], rng.randint(1, 5))
    return {name: round(value, 3) for name, value in figures.items() if name in kept}


def _promised(tables: Tables, faults: Sequence[dict[str, Any]], robots: int, tick_s: float) -> Capabilities:
    """Return what the robots promise under the faults, at the worst."""
    name = tables["backend"]
    backend = load_backend(name, to_open=False)
    nowhere = Workspace(1.0, 1.0, (), ())
    declared = backend.promises(backend.config_model(workspace=nowhere, **tables.get("backends", {}).get(name, {})))
    promises = []
    for robot_id in range(1, robots + 1):
        made = []
        for table in faults:
            if table.get("robot", "all") in ("all", robot_id):
                kind: type[Fault[Any]] = resolve_name(FAULT_KINDS[table["kind"]])
                options: FaultOptions = kind.options_model.model_validate(table)
                made.append(kind(options, Context(robot_id, tick_s, Random(0))))
        promises.append(widened(declared, made))
    return worst(promises)


def _battery(rng: Random, floor: Floor, figures: Figures, module: Tables, ids: Sequence[int], nasty: bool) -> Tables:
    """Return the batteries, and put into the battery's module what they ask for."""
    longest_m = (1.0 if not floor.boxes else 2.0) * (floor.width + floor.depth)
    reserve = rng.uniform(1.0, 10.0) if nasty else rng.uniform(2.5, 6.0)
    if rng.random() < 0.3:
        reserve = 4.0
    else:
        reserve = module["reserve_factor"] = round(reserve, 2)
    drive_s = math.exp(rng.uniform(math.log(200.0), math.log(3600.0)))
    # What has to be in the battery before the AC may have the robot: the way home, its jump, and the reserve.
    needed_s = (reserve + 2.0) * longest_m / figures.promise.v_max_m_s
    part = rng.uniform(0.3, 0.9) if nasty else rng.uniform(0.15, 0.7)
    table: Tables = {}
    if rng.random() < 0.15 and needed_s < part * 1800.0:
        drive_s = 1800.0
    else:
        drive_s = table["drive_s"] = round(max(drive_s, needed_s / part), 1)
    needed = needed_s / drive_s
    if rng.random() < 0.8 or needed > 0.75 or drive_s > 7200.0:
        module["phi_safer"] = round(rng.uniform(min(0.97, needed + 0.1), 1.0 if nasty else 0.97), 3)
    if drive_s > 7200.0 or rng.random() < 0.7:
        table["idle_s"] = round(drive_s * rng.uniform(1.0 if nasty else 2.0, 8.0), 1)
    if rng.random() < 0.7:
        table["charge_s"] = round(math.exp(rng.uniform(math.log(20.0), math.log(1800.0 if nasty else 600.0))), 1)
    if rng.random() < 0.5:
        # Some begin with hardly more than the way home asks for, and several have to charge at the same time.
        low = min(0.9, needed * (0.6 if nasty else 0.9) + 0.02)
        high = low + (1.0 - low) * rng.choice((0.1, 0.4, 1.0))
        chosen = [robot_id for robot_id in ids if rng.random() < 0.8]
        initial = {str(robot_id): round(rng.uniform(low, high), 3) for robot_id in chosen}
        if initial:
            table["initial"] = initial
    return table
